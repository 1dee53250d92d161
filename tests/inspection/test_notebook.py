"""What objects show of themselves in a notebook: small tables with units and pictures, in which all text is escaped."""

from __future__ import annotations

import html.parser
import io
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
import pytest
from PIL import Image

import davis_rs
from davis_rs import Dataset, Effects, EventComparison, Packet, load_scene
from davis_rs.sensor.effects import LeakRate
from davis_rs.sensor.presets import SENSORS
from davis_rs.simulation.planning import plan_effects
from written_sequence import HEIGHT, WIDTH, write_sequence

EVIL = "<script>alert('1')</script>"


class InNotebook(Protocol):
    """What a notebook asks for HTML."""

    def _repr_html_(self) -> str: ...


class Tags(html.parser.HTMLParser):
    """Checks that all tags that are opened are closed again, and keeps the text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: set[str] = set()
        self.text: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.add(tag)
        if tag != "img":
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.add(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def shown(thing: InNotebook) -> Tags:
    return Tags(thing._repr_html_())


def test_scene_camera_and_trajectory() -> None:
    scene = load_scene("three_planes")
    tags = shown(scene)
    assert {"Scene three_planes", "240 x 180 px", "2 s", "made in code"} <= set(tags.text)
    assert "svg" in tags.seen
    assert repr(scene) == "<Scene 'three_planes', 240 x 180 px, 2 s, C = 0.15>", "a terminal has what it had"
    assert {"Camera", "200, 200 px", "119.5, 89.5 px"} <= set(shown(scene.own_camera).text)
    assert {"duration", "2 s", "top speed"} <= set(shown(scene.path).text)
    still = replace(scene, trajectory=None, camera=None)
    assert "none" in shown(still).text


def test_effects_sensor_and_comparison_have_units() -> None:
    effects = Effects(refractory_period_us=100, leak_rate_hz=LeakRate(0.1), hot_pixels=0)
    text = " ".join(shown(effects).text)
    assert "refractory_period_us period_us = 100 us" in text
    assert "rate_hz = 0.1 Hz" in text
    assert "hot_pixels switched off" in text
    assert "events_per_s = 1000 events/s" in " ".join(shown(Effects(readout=1000)).text)
    assert "ideal pixels" in shown(Effects()).text
    assert {"refractory_period_us", "leak_rate_hz"} <= set(shown(SENSORS["davis240c"]).text)
    assert not {"None", "-"} & set(shown(SENSORS["davis240c"]).text)
    comparison = EventComparison(10, 9, 8, 2, 1, np.array([1.0, 3.0]))
    assert {"2, 20 % of the reference", "2 us"} <= set(shown(comparison).text)


@pytest.mark.usefixtures("llvm")
def test_a_plan_is_a_table() -> None:
    plan = plan_effects(load_scene("three_planes").crop(0, 0.01), {"leak_rate_hz": 0.1}, size=(12, 9))
    tags = shown(plan)
    assert {"EffectPlan", "leak_rate_hz"} <= set(tags.text)
    assert str(plan).splitlines()[0].split()[0] in " ".join(tags.text)


def test_a_dataset_has_its_counts_and_a_frame(tmp_path: Path) -> None:
    write_sequence(tmp_path / "d")
    tags = shown(Dataset(tmp_path / "d"))
    assert {f"{WIDTH} x {HEIGHT} px", "0.06 s", "frames", "events"} <= set(tags.text)
    assert "img" in tags.seen


def test_what_comes_from_files_is_escaped(tmp_path: Path) -> None:
    path = tmp_path / "<script>alert('1')<"
    write_sequence(path)
    scene = replace(load_scene("three_planes"), name=EVIL, note=EVIL, file=Path(EVIL), lights={}, objects={})
    for tags in (shown(scene), shown(Dataset(path))):
        assert "script" not in tags.seen
        assert "<script>alert('1')<" in "".join(tags.text)


def test_events_are_shown_as_a_picture(tmp_path: Path) -> None:
    """ON red, OFF blue, the last event of a pixel; by default what 0.2 events a pixel take around the middle."""
    events = davis_rs.event_array(t=[0, 10, 20, 30], x=[0, 1, 1, 3], y=[0, 0, 0, 1], p=[1, 1, 0, 1])
    picture = davis_rs.show(events, window_s=1.0)
    assert picture.image.shape == (2, 4, 3)
    red, blue, white = (202, 0, 32), (5, 113, 176), (255, 255, 255)
    assert [tuple(pixel) for pixel in picture.image[0]] == [red, blue, white, white]
    assert tuple(picture.image[1, 3]) == red
    assert repr(picture) == "<EventImage of 4 of 4 events, 1 s around t = 1.5e-05 s, 4 x 2 px>"
    assert {"img", "div"} <= shown(picture).seen
    picture.save(tmp_path / "events.png")
    assert np.array_equal(np.asarray(Image.open(tmp_path / "events.png")), picture.image)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(picture.png()))), picture.image)
    assert davis_rs.show(events, size=(6, 5), t_s=30e-6, window_s=1e-6).events == 1
    packet = Packet(0, 30, events, None, luma=np.ones((7, 9), np.float32))
    assert davis_rs.show(packet).image.shape == (7, 9, 3)
    assert davis_rs.show(events[:0]).events == 0
    with pytest.raises(ValueError, match="size is 3 x 5 px, but there is an event at column 3, row 1"):
        davis_rs.show(events, size=(3, 5))
    with pytest.raises(ValueError, match="window_s"):
        davis_rs.show(events, window_s=0)
