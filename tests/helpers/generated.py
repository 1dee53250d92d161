"""A small plan for the tests of davis_rs.generate: a chequered board that Mitsuba renders at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

BOARD = """
<scene version="3.0.0">
  <integrator type="direct"/>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 0, 1" target="0, 0.3, 0" up="0, 0, 1"/></transform>
  </sensor>
  <emitter type="point"><point name="position" x="0" y="0" z="3"/><rgb name="intensity" value="10"/></emitter>
  <shape type="rectangle">
    <transform name="to_world"><scale value="3"/></transform>
    <bsdf type="diffuse"><texture type="checkerboard" name="reflectance">
      <rgb name="color0" value="0.1"/><rgb name="color1" value="0.8"/>
      <transform name="to_uv"><scale x="12" y="12"/></transform>
    </texture></bsdf>
  </shape>
</scene>
"""

PLAN: dict[str, Any] = {
    "seed": 11,
    "sequences": 20,
    "scene": "scenes/board.xml",
    "camera": {"choice": ["ideal", "davis240c"]},
    "motion": {
        "choice": [
            {"kind": "slider", "distance_m": 0.5, "speed_m_s": {"uniform": [0.2, 1.0]}},
            {"kind": "walking", "duration_s": 0.5, "nod_deg": {"normal": [1.0, 0.5], "min": 0}},
        ]
    },
    "start": {"uniform": [0.0, 0.1]},
    "duration": {"uniform": [0.02, 0.03]},
    "contrast_threshold": {"log_uniform": [0.3, 0.6]},
    "effects": {"threshold_mismatch": {"uniform": [0, 0.05]}, "shot_noise_rms": {"choice": [0, 0.06]}},
    "imu": {"choice": [None, "mpu6150"]},
    "rays_per_pixel": 1,
    "max_displacement": 2,
    "frame_rate": 100,
    "depth_rate": {"choice": [0, 50]},
}


def write_plan(folder: Path, **changes: Any) -> Path:
    """The plan, with changes, and what belongs to it, in a folder."""
    (folder / "scenes").mkdir(parents=True, exist_ok=True)
    (folder / "scenes" / "board.xml").write_text(BOARD)
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump(PLAN | changes, sort_keys=False))
    return path


def files_of(root: Path) -> dict[str, bytes]:
    """Every file below a folder, hidden ones apart from the lock included, by its name."""
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }
