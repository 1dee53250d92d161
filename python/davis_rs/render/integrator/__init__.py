"""Mitsuba's own integrators, for every scene, with noise.

``renderer`` is that of the LLVM variant, ``scalar`` that of machines without LLVM; ``base`` is what they share.
"""
