"""A core's renderer of one triangle."""

from __future__ import annotations

from typing import Any

import numpy as np

from davis_rs._core import SceneRenderer


def one_triangle(**more: Any) -> SceneRenderer:
    """One of a single texel in constant light; ``more`` takes the place of its arguments."""
    arguments: dict[str, Any] = {
        "corners": np.array([0, 0, 1, 1, 0, 1, 0, 1, 1], np.float64),
        "planes": np.array([0, 0, 1, -1], np.float64),
        "u_maps": np.zeros(4),
        "v_maps": np.zeros(4),
        "normal_maps": None,
        "textures": np.zeros(1, np.uint32),
        "two_sided": np.ones(1, np.uint32),
        "frames": np.zeros(1, np.uint32),
        "frame_count": 1,
        "layouts": np.array([0, 1, 1, 0], np.int64),
        "texels": [np.full(9, 0.5, np.float32)],
        "lights": [("constant", 0, 1.0, 0.0, [0.0, 0.0, 0.0], None, None)],
        "shadows": True,
        "centre": [0.0, 0.0, 1.0],
        "step": 1e-4,
        "end": 1e-3,
        "threads": 2,
    }
    return SceneRenderer(**(arguments | more))
