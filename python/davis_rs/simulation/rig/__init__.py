"""Simulates rigs: each camera of one is a simulator of today, on its own path and by its own clock.

``rig_cameras`` says what each camera's scene and settings are; ``rig_simulator`` runs the simulators in step, or pose
after pose; ``rig_to_folder`` writes them. What is the same for all cameras is made once: the scene, its tables and its
BVH (``render.scene_cache``), baked light, IMUs, and the rays of equal lenses.
"""

from .rig_simulator import RigPacket, RigSimulator, simulate_rig
from .rig_to_folder import RigReport, simulate_rig_to_folder

__all__ = ["RigPacket", "RigReport", "RigSimulator", "simulate_rig", "simulate_rig_to_folder"]
