"""Renders any scene with Mitsuba's own integrators, with noise.

``renderer`` is for the LLVM variant, ``scalar`` for machines without LLVM; ``base`` is what they share.
"""
