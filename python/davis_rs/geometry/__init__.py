"""Describes where a camera is and how it sees: poses, paths, lenses, and the lattice of rays in a pixel.

``pose`` and ``camera`` are what users see; ``trajectory`` has the paths; ``lattice`` the positions of rays in a pixel;
``box`` the corners of boxes.

Pixel centres lie at integers, as in OpenCV and in the public calibrations. A camera is its lens and its size: a
``calib.txt`` holds no size, and sizes that contradict each other are errors, never a guess.
"""
