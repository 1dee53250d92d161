"""Skies of older versions of Mitsuba."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import davis_rs
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs.scene.repairs import SceneFileWarning

SCENE = """<scene version="{version}"><integrator type="path"/>{light}<shape type="sphere"/></scene>"""
SUN = np.array([0.6, 0.5, -0.3]) / np.linalg.norm([0.6, 0.5, -0.3])
DIRECTION = f'<vector name="{{}}" x="{SUN[0]}" y="{SUN[1]}" z="{SUN[2]}"/>'


def sky_file(folder: Path, kind: str, more: str = "", version: str = "0.6.0") -> Path:
    name = "sunDirection" if version < "2" else "sun_direction"
    light = f'<emitter type="{kind}">{DIRECTION.format(name)}{more}</emitter>'
    path = folder / "sky.xml"
    path.write_text(SCENE.format(version=version, light=light))
    return path


def radiance(path: Path, *directions: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the radiance (n) that comes from directions, green."""
    with variant(SCALAR) as (mi, _):
        sky = load_scene_source(path, mi).environment()
        found = []
        for direction in directions:
            hit = mi.SurfaceInteraction3f()
            hit.wi = mi.Vector3f(-np.asarray(direction, np.float64) / np.linalg.norm(direction))
            found.append(float(np.array(sky.eval(hit))[1]))
        return np.array(found)


def test_the_sky_of_older_versions_has_y_up(tmp_path: Path) -> None:
    """Above all is sky, brightest at the sun, and below nothing; a transform turns it on."""
    path = sky_file(tmp_path, "sunsky")
    near_sun, up, beside, below = np.add(SUN, [0, 0.05, 0]), [0, 1, 0], [0, 0.2, 1], [0, -0.2, 1]
    at_sun, around, above, aside, ground = radiance(path, SUN, near_sun, up, beside, below)
    assert at_sun > 1e3 * around > 1e3 * above > 0
    assert around > aside > 0
    assert ground == 0
    with pytest.warns(SceneFileWarning, match="its light 'sunsky' is taken as the 'sunsky' of Mitsuba 3"):
        davis_rs.load_scene(path)
    turned = sky_file(tmp_path, "sunsky", '<transform name="toWorld"><rotate x="1" angle="-90"/></transform>')
    assert radiance(turned, [0, 0, -1])[0] > 0
    assert radiance(turned, [0, 0, 1])[0] == 0


def test_sun_and_sky_are_one_light_without_the_other(tmp_path: Path) -> None:
    beside = [0, 0.4, 1]
    both = radiance(sky_file(tmp_path, "sunsky"), SUN, beside)
    sky = radiance(sky_file(tmp_path, "sky", '<float name="scale" value="2"/>'), SUN, beside)
    sun = radiance(sky_file(tmp_path, "sun", '<float name="scale" value="3"/>'), SUN, beside)
    np.testing.assert_allclose([sky[1], sun[1]], [2 * both[1], 0], rtol=1e-5)
    np.testing.assert_allclose(sun[0] / 3 + sky[0] / 2, both[0], rtol=1e-4)


def test_a_larger_sun_is_as_strong(tmp_path: Path) -> None:
    """Its radius is a factor, and its light is spread over the square of it."""
    one, five = (
        radiance(sky_file(tmp_path, "sun", f'<float name="sunRadiusScale" value="{scale}"/>'), SUN)[0]
        for scale in (1, 5)
    )
    assert five == pytest.approx(one / 25, rel=0.02)


def test_skies_of_mitsuba_3_stay_as_they_are(tmp_path: Path) -> None:
    path = sky_file(tmp_path, "sunsky", '<transform name="to_world"><rotate x="1" angle="-90"/></transform>', "3.0.0")
    assert radiance(path, [0, 1, 0])[0] > 0
    assert radiance(path, [0, -1, 0])[0] == 0
