"""Makes the rays of a camera's pixels, and says where shadow rays begin and end.

Undistorted directions are computed once for each pixel and ray, so that a lens costs nothing per frame. All
renderers that trace shadows take the two numbers of ``shadow_rays``. ``frame_sampler`` gives Mitsuba's integrators
random numbers that depend only on the seed and on the number of a ray in the frame, so that a still image makes no
events.
"""
