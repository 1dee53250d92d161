"""Makes events from frames: video, image folders and arrays, seen by the pixels of an event camera.

``frames_folder`` (a dataset folder), ``events_from_frames`` (packets) -> ``frame_run`` -> ``resolved_frames`` (all
that is decided) -> ``interpolation``, ``frames_between`` (flow, a user's interpolator) -> ``optical_flow``;
``images_between`` (intensity frames at a rate of their own); ``light``
(values to luma), ``quantisation`` (the dark level), ``frame_values``, ``frame_part``; ``open_frames`` -> ``video``
(PyAV), ``image_folder`` -> ``image_file``, ``array_frames`` -> ``stamps`` -> ``frame_source``.

Frames have no scene: packets have no pose, and a folder has a ``calib.txt`` only where a lens is given. Video is
read by PyAV, whose frames bring their own stamps, range, matrix and transfer function. The matrix is ours, in
float32, because FFmpeg's conversion would round to 8 bits a second time.
"""
