"""Defines rules of sampling in time: when to render, and how to interpolate between two renders.

``presets`` -> ``tolerance`` (adaptive) -> ``keyframe_window`` (its estimate), ``rules`` (planned),
``event_refinement`` (event times), ``exposure`` (frames) -> ``displacement``, ``plausibility`` (probes) ->
``keyframes`` -> ``breaks`` (where motion and light are not smooth); ``observe``, ``interpolate``.

A rule yields keyframes: luma, perhaps rates, perhaps samples of single pixels since the keyframe before. The crossing
engine takes all three, so a new rule is one more file. The adaptive rule takes the slopes of its cubics from
neighbouring keyframes, not from the renderer's derivative: they cost nothing, and they filter the lattice's noise.
Every frame and depth map is one of the samples that the engine saw.
"""
