"""Simulates: settings, what is decided from them, packets of events, and the folder that they are written to.

``folder`` (a dataset folder) -> ``simulate`` (effects planned where asked for, then packets) -> ``simulator`` (a
whole path, or pose after pose) -> ``due_instants``, ``run_description`` (meta.json), ``no_events``. ``frame_gain``
chooses how bright a folder's frames are. ``settings`` are declared once and resolved with a scene.
``monte_carlo_noise`` measures how many events of Mitsuba's integrators are noise; ``noise_estimate`` is what is said
of it. ``rig`` runs several cameras in step.
``planning`` chooses effects, ``from_frames`` takes video and
images in place of a scene, ``virtual_scene`` gives a camera's bytes. ``model_version`` says by which model events
are made.

``step`` returns packets, because between two poses of a controller several frames may fall due. Noise is measured,
not modelled: averages of disjoint seeds are runs of more samples, and each is matched with all others.
"""
