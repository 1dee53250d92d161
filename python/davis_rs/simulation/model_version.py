"""Names the version of the model by which events are made."""

MODEL = 2
"""It grows with every change after which the same scene, frames and settings give other events. ``meta.json`` has it
under ``model``.

1. davis_rs 0.2.0, whose folders do not say it.
2. The first references of pixels are drawn by one law, which does not depend on the effects that are there. The next
   event of a pixel waits until its last one was read out. Frames of integers are taken in the steps that their values
   have.
"""
