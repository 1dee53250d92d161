"""The count of wrong events on foreign worlds: on luma that is known, and on a small file from end to end."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from path_tracer import C
from worlds_events import HEADS, RUNS, Judge, Span, main

from davis_rs.events.luma import LumaFrames

INSTANTS = 9
SPAN = Span(np.linspace(0.0, 0.008, INSTANTS), 1000)
NOISY = 3
"""The column of pixels whose runs scatter."""

WORLD = """<scene version="3.0.0"><integrator type="direct"/>
<emitter type="point"><point name="position" value="1, 1, 3"/></emitter>
<sensor type="perspective"><transform name="to_world"><lookat origin="0, 0, 3" target="0, 0, 0" up="0, 1, 0"/>
</transform><film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="36"/></film></sensor>
<shape type="rectangle"><bsdf type="diffuse"><texture type="checkerboard" name="reflectance">
<transform name="to_uv"><scale value="8"/></transform></texture></bsdf></shape></scene>"""


def rising(events: float) -> LumaFrames:
    """Return luma (instants, 2, 4) that rises by as many events a pixel as there are thresholds in ``events``."""
    rise = np.exp(np.linspace(0.0, events * C, INSTANTS))
    return np.broadcast_to(rise[:, None, None], (INSTANTS, 2, 4)).astype(np.float32)


def judge() -> Judge:
    """Judge against 2.5 events a pixel, from runs whose halves differ by one event in the last column."""
    runs = np.stack([rising(2.5)] * (2 * RUNS))
    runs[:RUNS, :, :, NOISY] = rising(3.5)[:, :, NOISY]
    return Judge(SPAN, runs)


def cells(row: str) -> list[str]:
    return [cell.strip() for cell in row.strip("|").split("|")]


def test_halves_say_the_noise_and_where_the_reference_is_sure() -> None:
    judged = judge()
    assert not judged.sure[:, NOISY].any()
    assert judged.sure[:, :NOISY].all()
    # One half has 3 events in the last column where the other has 2, at other times.
    of_all, of_sure = judged.noise
    assert of_all >= 100 * 2 / (8 * 2)
    assert of_sure == 0.0


def test_missing_and_spurious_events_are_counted_once_each() -> None:
    judged = judge()
    assert cells(judged.row("world", "ours", judged.mean, 3.0))[3:7] == ["0.0", "0.0", "75%", "0.0"]
    fewer = judged.mean.copy()
    fewer[:, 0, 0] = 1.0
    wrong = cells(judged.row("world", "ours", fewer, 3.0))
    assert wrong[2] == "2.2"  # 3 where the halves differ
    assert wrong[6] == f"{100 * 2 / 12:.1f}"  # two of the twelve events of the sure pixels


def test_net_is_without_the_noise_of_the_mean() -> None:
    judged = judge()
    fewer = judged.mean.copy()
    fewer[:, :, 0] = 1.0
    row = cells(judged.row("world", "ours", fewer, None))
    wrong, noise = float(row[3]), judged.noise[0] / 2
    assert float(row[4]) == pytest.approx(np.sqrt(wrong**2 - noise**2), abs=0.1)
    assert float(row[4]) < wrong


@pytest.mark.usefixtures("llvm")
def test_a_world_has_a_row_for_its_reference_and_for_each_number_of_rays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "board.xml").write_text(WORLD)
    kept, pictures = tmp_path / "kept", tmp_path / "sheet.png"
    given = ["--samples", "8", "--width", "12", "--frames", "3", "--events", "0.5", "--rays", "0", "8"]
    given += ["--kept", str(kept), "--pictures", str(pictures)]
    monkeypatch.setattr(sys, "argv", ["worlds_events.py", str(tmp_path / "board.xml"), *given])
    main()
    head, _, halves, preset, few = map(cells, capsys.readouterr().out.strip().splitlines())
    assert head == list(HEADS)
    assert [row[1] for row in (halves, preset, few)] == [
        "8 paths, twice",
        "auto (native renderer), 8 lines",
        "auto (native renderer), 8 rays",
    ]
    assert float(halves[2]) > 0.3
    assert pictures.exists()
    assert len(list(kept.iterdir())) == 2 * RUNS
