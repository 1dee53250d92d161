"""Connects to a DAVIS on the USB, and to one in software.

``davis`` (what the user sees), ``raw_file`` -> ``settings`` (what is written) -> ``description`` (what the camera
says of itself); ``davis`` -> ``stream_reader`` (thread, queue) -> ``stream_gap``; ``link`` (the only one that does
USB) -> ``protocol`` (registers and orders, as data). ``virtual_davis`` answers descriptors and registers, and
``virtual_backend`` puts it below pyusb, so that the same code runs in tests, for ``record --virtual``, and against
a kernel.

Lost data leave their clock behind: times hang on wraps and places on rows, so a chunk that cannot be kept is
reduced to these words. A slow program loses events, never the time of those that follow.
"""
