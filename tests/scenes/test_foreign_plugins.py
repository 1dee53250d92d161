"""Mitsuba files with plug-ins, properties, elements and colours that this Mitsuba does not read."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

import davis_rs
from davis_rs import DecodeError
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.scene.repairs import SceneFileWarning

SQUARE = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
-1 -1 0
1 -1 0
1 1 0
-1 1 0
3 0 1 2
3 0 2 3
"""

SMOOTH, SHINE = '<float name="max_smooth_angle" value="40"/>', '<float name="shine" value="1"/>'
CHECKS = """<texture name="reflectance" type="bitmap"><string name="filename" value="checks.png"/>
    <string name="filter_type" value="bilinear"/></texture>"""
MEDIUM = '<medium name="interior" type="homogeneous"><float name="sigma_s" value="1"/></medium>'

PLAIN = {
    "integrator": '<integrator type="path"><integer name="max_depth" value="3"/></integrator>',
    "lookat": '<lookat origin="0.2, 0.1, 4" target="0, 0, 0" up="0, 1, 0"/>',
    "sampler": '<sampler type="independent"/>',
    "film": '<film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="36"/></film>',
    "shape": "",
    "file": "meshes/square.ply",
    "colour": '<rgb name="reflectance" value="0.5, 0.2, 0.1"/>',
    "bsdf": "diffuse",
}


def scene_file(folder: Path, **parts: str) -> Path:
    """Write a scene of a square under a lamp, with other parts than the plain ones."""
    text = {**PLAIN, **parts}
    (folder / "meshes").mkdir(exist_ok=True)
    (folder / "meshes" / "square.ply").write_text(SQUARE)
    path = folder / "scene.xml"
    path.write_text(f"""<scene version="3.0.0">
    {text["integrator"]}
    <sensor type="perspective"><float name="fov" value="40"/>
        <transform name="to_world">{text["lookat"]}</transform>
        {text["sampler"]}
        {text["film"]}
    </sensor>
    <shape type="ply"><string name="filename" value="{text["file"]}"/>{text["shape"]}
        <bsdf type="{text["bsdf"]}">{text["colour"]}</bsdf>
    </shape>
    <emitter type="point"><point name="position" x="1" y="2" z="5"/><rgb name="intensity" value="20"/></emitter>
</scene>""")
    return path


def luma(path: Path) -> npt.NDArray[np.float32]:
    """Return what the scene's own camera sees of it at the start."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneFileWarning)
        scene = davis_rs.load_scene(path)
    camera, start = scene.own_camera, scene.start
    assert camera is not None
    assert start is not None
    assert (camera.width, camera.height) == (48, 36)
    return make_renderer(scene, camera, blur=False).luma(Views.at_rest([start]))


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        (
            {"integrator": PLAIN["integrator"].replace('"path">', '"bdpt"><float name="time" value="1"/>')},
            "its integrator 'bdpt', which this Mitsuba cannot use, is replaced by 'path'",
        ),
        (
            {"integrator": '<integrator type="transient"/>'},
            "its integrator 'transient', which this Mitsuba cannot use, is replaced by 'path'",
        ),
        (
            {"integrator": f'<integrator type="stokes">{PLAIN["integrator"]}</integrator>'},
            "its integrator 'stokes' is replaced by 'path', which is in it",
        ),
        (
            {
                "integrator": '<integrator type="aov"><string name="aovs" value="e:none"/>'
                f"{PLAIN['integrator']}</integrator>"
            },
            None,
        ),
        (
            {"integrator": PLAIN["integrator"].replace('"path"', '"ptracer"')},
            "its integrator 'ptracer' is replaced by 'path', which has the same light with less noise",
        ),
        (
            {"integrator": PLAIN["integrator"].replace('"path"', '"prb"')},
            "its integrator 'prb' is replaced by 'path', which has the same light, for a renderer that needs no "
            "derivatives",
        ),
        (
            {"integrator": '<integrator type="direct_projective"><integer name="sppc" value="4"/></integrator>'},
            "its integrator 'direct_projective' is replaced by 'direct', which has the same light, for a renderer "
            "that needs no derivatives",
        ),
        ({"colour": CHECKS.replace("bilinear", "ewa")}, None),
        ({"colour": CHECKS.replace("bilinear", "trilinear")}, None),
        ({"sampler": '<sampler type="sobol"><integer name="scramble" value="1"/></sampler>'}, None),
        ({"film": PLAIN["film"].replace("hdrfilm", "phasor_film")}, None),
        ({"film": PLAIN["film"].replace("</film>", '<string name="pixel_format" value="transient"/></film>')}, None),
        ({"film": PLAIN["film"].replace("</film>", '<rfilter type="sinc9"/></film>')}, None),
        (
            {"shape": SMOOTH},
            "max_smooth_angle of a ply is left out, because this Mitsuba does not read it",
        ),
        ({"lookat": PLAIN["lookat"].replace("lookat", "lookAt")}, None),
        (
            {"shape": '<sensor type="irradiancemeter"/>'},
            "its sensor 'irradiancemeter', which is no camera of this Mitsuba, is left out",
        ),
        (
            {"integrator": '<integrator type="path"/><sensor type="coded"><float name="gain" value="2"/></sensor>'},
            "its sensor 'coded', which is no camera of this Mitsuba, is left out",
        ),
        (
            {"integrator": '<integrator type="path"/><chains><integer name="number" value="128"/></chains>'},
            "its settings 'chains', which are none of Mitsuba's, are left out",
        ),
        (
            {"integrator": '<integrator type="path"/><mode type="final"/>'},
            "its settings 'mode', which are none of Mitsuba's, are left out",
        ),
        (
            {"film": PLAIN["film"] + '<string name="fovAxis" value="x"/>'},
            "its former name 'fovAxis' is read as 'fov_axis'",
        ),
        (
            {
                "integrator": PLAIN["integrator"]
                + '<bsdf type="null" id="air"/><shape type="cube"><ref id="air"/></shape>'
            },
            "1 of its shapes let all light pass ('null'), and are left out",
        ),
        (
            {
                "integrator": PLAIN["integrator"]
                + '<shape type="cube"><bsdf type="null"/><sensor type="irradiancemeter"/></shape>'
            },
            "its sensor 'irradiancemeter', which is no camera of this Mitsuba, is left out; "
            "1 of its shapes let all light pass ('null'), and are left out",
        ),
        ({"colour": PLAIN["colour"].replace("rgb", "spectrum")}, None),
        ({"colour": PLAIN["colour"].replace("0.5, 0.2, 0.1", "0.5 .2,1e-1").replace("rgb", "spectrum")}, None),
        ({"colour": PLAIN["colour"].replace("<rgb", '<rgb intent="reflectance"')}, None),
        ({"colour": '<rgb value="#7f331a" name="reflectance"/>'}, None),
        ({"colour": "<srgb name='reflectance' value='0.735357, 0.484529, 0.349190'/>"}, None),
        ({"colour": '<srgb name="reflectance" value="#bc7c59"></srgb>'}, None),
        ({"file": "meshes\\square.ply"}, None),
    ],
)  # fmt: skip
def test_what_does_not_say_how_a_scene_looks_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, parts: dict[str, str], told: str | None
) -> None:
    Image.fromarray(np.array([[[10, 20, 30], [200, 210, 220]]] * 2, np.uint8)).save(tmp_path / "checks.png")
    plain = luma(scene_file(tmp_path, colour=CHECKS) if "texture" in parts.get("colour", "") else scene_file(tmp_path))
    assert plain.max() > 0.01
    path = scene_file(tmp_path, **parts)
    monkeypatch.chdir("/")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        davis_rs.load_scene(path)
    assert [str(one.message) for one in caught] == ([] if told is None else [f"{path}: {told}"])
    # Colours of 8 bits are rounded.
    np.testing.assert_allclose(luma(path), plain, rtol=0.01 if "#" in parts.get("colour", "") else 1e-5)


@pytest.mark.parametrize("camera", [True, False])
def test_a_scene_without_lights_gets_some(tmp_path: Path, camera: bool) -> None:
    """A sun behind the camera, which lights what it looks at from its upper left; its names are no others' ids."""
    path = scene_file(tmp_path, shape='<rgb name="shine" value="1"/>')
    text = re.sub(r"<emitter.*</emitter>", "", path.read_text()).replace(
        '<bsdf type="diff', '<bsdf id="sun" type="diff'
    )
    path.write_text(text if camera else re.sub(r"(?s)<sensor.*</sensor>", "", text))
    with pytest.warns(SceneFileWarning, match="it has no lights, so a sun behind the camera and light from all sides"):
        scene = davis_rs.load_scene(path)
    with variant(SCALAR) as (mi, _):
        sun, sky = load_scene_source(scene.source(), mi).emitters()
        assert "constant" in str(sky).lower()
        towards = np.array(mi.traverse(sun)["to_world"].matrix, np.float64).reshape(4, 4)[:3, 2]
    if camera:
        assert scene.start is not None
        np.testing.assert_allclose(scene.start.rotation.T @ towards, np.array([0.6, 0.6, 1]) / 1.72**0.5, atol=1e-6)
        assert luma(path).max() > 0.01


@pytest.mark.parametrize("kind", ["prb", "prb_basic", "prb_projective", "prbvolpath", "direct_projective"])
def test_integrators_for_derivatives_make_way_for_those_that_follow_rays(tmp_path: Path, kind: str) -> None:
    path = scene_file(tmp_path, integrator=f'<integrator type="{kind}"/>')
    with pytest.warns(SceneFileWarning, match="has the same light"):
        scene = davis_rs.load_scene(path)
    assert scene.own_camera is not None
    assert scene.start is not None
    renderer = make_renderer(scene, scene.own_camera, kind="integrator", rays_per_pixel=4, blur=False)
    at_start = Views.at_rest([scene.start])
    np.testing.assert_allclose(renderer.luma(at_start).mean(), luma(path).mean(), rtol=0.02)


@pytest.mark.parametrize("lost", ["0 0 0", "-0.0  0.000 0e0\r", "nan 0 1"])
@pytest.mark.parametrize("given", ["", '<boolean name="face_normals" value="false"/>'])
def test_meshes_with_normals_without_a_direction_are_flat(tmp_path: Path, lost: str, given: str) -> None:
    """Mitsuba refuses such normals of OBJ files, unless it does not read them."""
    corners = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n"
    faces = "vn 0 0 1\nvn {}\nf 1//1 2//1 3//2\nf 1//1 3//2 4//1\n"
    (tmp_path / "square.obj").write_bytes((corners + faces.format("0 0 1")).encode())
    whole = scene_file(tmp_path)
    expected = luma(whole)
    whole.write_text(whole.read_text().replace('type="ply"', 'type="obj"').replace("meshes/square.ply", "square.obj"))
    np.testing.assert_allclose(luma(whole), expected, rtol=1e-5)
    (tmp_path / "square.obj").write_bytes((corners + faces.format(lost)).encode())
    whole.write_text(whole.read_text().replace('<bsdf type="diff', f'{given}<bsdf type="diff'))
    with pytest.warns(SceneFileWarning, match="meshes square.obj have normals without a direction, so their faces"):
        davis_rs.load_scene(whole)
    np.testing.assert_allclose(luma(whole), expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("given", "same"),
    [
        ('<rgb name="reflectance" value="255, 51, 0"/>', "0.99, 0.198, 0"),
        ('<spectrum name="reflectance" value="2, 1, 1"/>', "0.99, 0.495, 0.495"),
        ('<texture name="reflectance" type="checkerboard"><rgb name="color0" value="30, 30, 30"/>'
         '<rgb name="color1" value="30, 30, 30"/></texture>', "0.99, 0.99, 0.99"),
    ],
)  # fmt: skip
def test_reflectances_above_1_are_scaled(tmp_path: Path, given: str, same: str) -> None:
    """As Mitsuba 0.6 scales them; Mitsuba 3 refuses them. What lights emit stays as it is."""
    expected = luma(scene_file(tmp_path, colour=f'<rgb name="reflectance" value="{same}"/>'))
    path = scene_file(tmp_path, colour=given)
    with pytest.warns(
        SceneFileWarning, match=r"reflectances above 1 \(up to \d+\) are scaled to 0\.99, as in Mitsuba 0\.6"
    ):
        davis_rs.load_scene(path)
    np.testing.assert_allclose(luma(path), expected, rtol=1e-5)


def test_an_orthographic_sensor_says_where_a_camera_starts(tmp_path: Path) -> None:
    """Its axes are scaled by the size of its image."""
    expected = davis_rs.load_scene(scene_file(tmp_path)).start
    path = scene_file(tmp_path, lookat='<scale x="1.5" y="1.5"/>' + PLAIN["lookat"])
    text = path.read_text().replace('<float name="fov" value="40"/>', "")
    path.write_text(text.replace('type="perspective"', 'type="orthographic"'))
    with pytest.warns(SceneFileWarning, match="its first sensor is not perspective, so it says no more than where a"):
        scene = davis_rs.load_scene(path)
    assert scene.camera is None
    assert scene.start is not None
    assert expected is not None
    np.testing.assert_allclose(scene.start.matrix, expected.matrix, atol=1e-6)


def test_media_are_shown_in_the_place_of_unknown_integrators(tmp_path: Path) -> None:
    fog = '<medium type="homogeneous" id="fog"><float name="sigma_t" value="1"/></medium>'
    path = scene_file(tmp_path, integrator=f'<integrator type="bdpt"/>{fog}')
    with variant(SCALAR) as (mi, _):
        assert load_scene_source(path, mi).integrator().class_name() == "VolumetricPathIntegrator"


def test_the_integrator_within_another_keeps_its_numbers(tmp_path: Path) -> None:
    inner = f'<integrator type="aov"><string name="aovs" value="e:none"/>{PLAIN["integrator"]}</integrator>'
    path = scene_file(tmp_path, integrator=f'<integrator type="stokes">{inner}</integrator>')
    with variant(SCALAR) as (mi, _):
        assert "max_depth = 3" in str(load_scene_source(path, mi).integrator())


@pytest.mark.parametrize("part", [MEDIUM.replace("sigma_s", "sigma_t"), '<emitter type="area"/>'])
def test_null_surfaces_that_count_are_kept(tmp_path: Path, part: str) -> None:
    """Those that bound a medium or emit."""
    null = f'<integrator type="path"/><shape type="cube"><bsdf type="null"/>{part}</shape>'
    path = scene_file(tmp_path, integrator=null)
    with variant(SCALAR) as (mi, _):
        assert len(load_scene_source(path, mi).shapes()) == 2


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"bsdf": "irawan"}, 'Plugin "irawan" not found'),
        (
            {"bsdf": "irawan", "integrator": '<integrator type="bdpt"/>'},
            r'scene.xml \(line .*Plugin "irawan" not found',
        ),
        ({"colour": PLAIN["colour"] + SHINE}, "has shine of a diffuse, .* which says how it looks"),
        ({"colour": PLAIN["colour"] + SHINE, "shape": SMOOTH}, "has shine of a diffuse, "),
        ({"integrator": '<integrator type="path"/><camera><transform name="to_world"/></camera>'}, "<camera>"),
        ({"integrator": '<integrator type="path"/><mesh type="obj"><string name="a" value="b"/></mesh>'}, "<mesh>"),
        ({"shape": SMOOTH + MEDIUM}, "has sigma_s of a homogeneous, "),
        ({"file": "meshes\\circle.ply"}, r"scene.xml \(line .*circle.ply"),
        ({"colour": '<srgb name="reflectance" value="red"/>'}, "srgb"),
        ({"colour": '<spectrum name="reflectance" value="0.1, 0.2"/>'}, "spectrum"),
    ],
)  # fmt: skip
def test_what_says_how_a_scene_looks_is_refused(tmp_path: Path, parts: dict[str, str], message: str) -> None:
    path = scene_file(tmp_path, **parts)
    with pytest.raises(ValueError, match=f"(?s)cannot load {path}.*{message}"):
        davis_rs.load_scene(path)


def test_meshes_are_checked_whatever_their_names_look_like(tmp_path: Path) -> None:
    """Mitsuba ends the process at a face that names missing vertices."""
    path = scene_file(tmp_path, file="meshes\\square.ply")
    (tmp_path / "meshes" / "square.ply").write_text(SQUARE.replace("3 0 1 2", "3 0 1 7"))
    with pytest.raises(DecodeError, match="a face names vertex 7 of 4"):
        davis_rs.load_scene(path)


@pytest.mark.parametrize("filler", ['name="filename" ', 'value = "1 ', "srgb value= "])
def test_long_comments_take_no_long_time(tmp_path: Path, filler: str) -> None:
    """A search that began anew at each repetition would take minutes."""
    path = scene_file(tmp_path, integrator='<integrator type="bdpt"/>', shape=f"<!-- {filler * 200_000} -->")
    with pytest.warns(SceneFileWarning, match="bdpt"):
        davis_rs.load_scene(path)


def start_of(path: Path) -> npt.NDArray[np.float64]:
    """Return the pose of the scene's camera as a matrix."""
    start = davis_rs.load_scene(path).start
    assert start is not None
    return start.matrix


def test_a_camera_that_mirrors_is_one_that_does_not(tmp_path: Path) -> None:
    mirrored, plain = (
        f'<matrix value="{x} 0 0 0.2  0 1 0 0.1  0 0 -1 4  0 0 0 1"/>' for x in (1, -1)
    )  # Mitsuba's cameras look along z, with x to the left.
    with pytest.warns(SceneFileWarning, match="the scene's camera mirrors its image"):
        start = start_of(scene_file(tmp_path, lookat=mirrored))
    np.testing.assert_array_equal(start, start_of(scene_file(tmp_path, lookat=plain)))


def test_a_camera_may_be_rounded_and_not_more(tmp_path: Path) -> None:
    at = '<matrix value="-0.9988 0 -0.0499 0.2  -0.0012 0.9997 0.0249 0.1  {z}  0 0 0 1"/>'
    turn = start_of(scene_file(tmp_path, lookat=at.format(z="0.0499 0.0250 -0.9984 4")))[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(turn[:, 2], [-0.0499, 0.0249, -0.9984], atol=2e-4)
    with pytest.raises(ValueError, match=r"rotation|[Ss]cale"):
        davis_rs.load_scene(scene_file(tmp_path, lookat=at.format(z="0.0999 0.0500 -1.9968 4")))
