"""What objects show of themselves in a notebook: small tables with units and pictures, in which all text is escaped."""

from __future__ import annotations

import base64
import html.parser
import io
import re
import signal
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

import davis_rs
from davis_rs import Dataset, Effects, EventComparison, Packet, Pose, Simulator, load_scene
from davis_rs.geometry.camera import Camera
from davis_rs.io.dataset.writer import DatasetWriter
from davis_rs.render import thumbnail
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.sensor.effects import LeakRate
from davis_rs.sensor.presets import SENSORS
from davis_rs.simulation.planning import plan_effects
from lamp_box import lamp_box
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


def picture_of(html_text: str) -> npt.NDArray[np.uint8]:
    found = re.search(r"data:image/png;base64,([^']+)'", html_text)
    assert found is not None
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(found.group(1)))))


def test_a_scene_has_a_picture_of_what_its_camera_sees_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first frame, small and lighter; rendered once for an object."""
    scene = load_scene("three_planes")
    made: list[object] = []

    def counted(*arguments: Any, **more: Any) -> Renderer:
        made.append(arguments)
        return make_renderer(*arguments, **more)

    monkeypatch.setattr(thumbnail, "make_renderer", counted)
    html_text = scene._repr_html_()
    assert scene._repr_html_() == html_text
    assert len(made) == 1
    assert "luma at t = 0" in shown(scene).text
    picture = picture_of(html_text)
    assert picture.shape == (120, 160)
    frame = next(Simulator(scene, rays_per_pixel=8).run()).luma
    assert frame is not None
    small = np.asarray(Image.fromarray(frame).resize((160, 120), Image.Resampling.BOX))
    assert np.corrcoef(picture.ravel(), small.ravel() ** (1 / 2.4))[0, 1] > 0.97
    tall = replace(scene, camera=Camera(100, 400, 200.0, 200.0, 49.5, 199.5))
    assert picture_of(tall._repr_html_()).shape == (160, 40)
    tiny = replace(scene, camera=Camera(12, 9, 10.0, 10.0, 5.5, 4.0), trajectory=None, start=scene.path.pose(0.0))
    assert picture_of(tiny._repr_html_()).shape == (9, 12)
    assert "luma from where a camera starts" in shown(tiny).text


def test_a_scene_without_a_picture_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    """It never raises an error, and gives up after a while; Ctrl-C is still the user's."""
    scene = load_scene("three_planes")
    assert "no picture: the scene has no camera path" in shown(replace(scene, trajectory=None, start=None)).text

    def broken() -> Any:
        raise RuntimeError(EVIL)

    tags = shown(replace(scene, source=broken))
    assert "script" not in tags.seen
    assert f"no picture: {EVIL}" in "".join(tags.text)

    def endless() -> Any:
        time.sleep(30)

    monkeypatch.setattr(thumbnail, "_LONGEST_S", 0.05)
    before = signal.getsignal(signal.SIGALRM)
    began = time.monotonic()
    assert "no picture: it takes longer than 0.05 s" in shown(replace(scene, source=endless)).text
    assert time.monotonic() - began < 5
    assert signal.getsignal(signal.SIGALRM) == before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)

    def interrupted() -> Any:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        replace(scene, source=interrupted)._repr_html_()


def test_a_scene_that_the_native_renderer_cannot_render_has_a_picture_too() -> None:
    """An area light needs Mitsuba's integrators, or light that is baked first."""
    picture = picture_of(lamp_box()._repr_html_())
    assert picture.std() > 5


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


def test_a_dataset_shows_its_frame_as_a_display_wants_it_and_its_events(tmp_path: Path) -> None:
    """Two pictures: linear light is encoded, and events have their colours; too many of them are not read."""
    luma = np.full((HEIGHT, WIDTH), 0.2, np.float32)
    events = davis_rs.event_array(t=[10, 20], x=[1, 5], y=[2, 6], p=[1, 0])
    with DatasetWriter(tmp_path / "d", Camera(WIDTH, HEIGHT, 20, 20, 11.5, 8.5), image_gain=1.0) as writer:
        writer.write(Packet(0, 100, events, Pose([0, 0, 0], [0, 0, 0, 1]), luma))
    shown_html = Dataset(tmp_path / "d")._repr_html_()
    frame, drawn = (picture_of(part) for part in shown_html.split("<img")[1:])
    assert frame[0, 0].tolist() == pytest.approx([124] * frame.shape[2] if frame.ndim == 3 else 124, abs=2)
    assert tuple(drawn[2, 1][:3]) == (202, 0, 32)
    assert tuple(drawn[6, 5][:3]) == (5, 113, 176)
    assert "2 events in" in shown_html


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
