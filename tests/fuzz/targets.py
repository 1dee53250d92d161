"""What is fuzzed: for each reader, files to begin with, and a call that reads one and checks what it gives."""

from __future__ import annotations

import base64
import hashlib
import random
import struct
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import zstandard

import davis_rs
from bag_databases import PROGRAMS, database, in_circles
from clips import write_exr
from davis_rs._mitsuba.animated_transforms import take_motions
from davis_rs._mitsuba.elements import written
from davis_rs._mitsuba.files import XmlFile, read_scene_file
from davis_rs._mitsuba.former_materials import translate
from davis_rs._mitsuba.former_notation import rewrite
from davis_rs._mitsuba.grey_materials import make_grey
from davis_rs._mitsuba.variants import SCALAR, variant
from davis_rs.generate import load_sequence_plan
from davis_rs.inspection.check import check_dataset
from davis_rs.inspection.summary import summarize_events
from davis_rs.io.files.random_access import RandomAccess
from davis_rs.io.formats.recorded import RecordedParts
from davis_rs.render.baked import cache
from davis_rs.render.baked.light_maps import LightMaps, check_maps, layouts_of, texel_count, vector_layouts_of
from davis_rs.sensor.presets import preset_file, read_sensor_file, sensor_yaml
from davis_rs.simulation.from_frames.image_file import read_frame_image
from davis_rs.usb.raw_file import RawRecording, RawWriter
from event_files import many
from gltf_files import CORNERS, UV, Gltf, packed_square, quad
from ktx2_files import ktx2, uastc
from recording_files import (
    DESCRIPTION,
    aedat2,
    aedat2_event,
    aedat2_imu,
    aedat3,
    aedat3_event,
    aedat3_frame,
    aedat3_imu,
    aedat3_packet,
    aedat3_special,
    aedat4,
    aedat4_events,
    aedat4_frame,
    aedat4_imu,
    aedat4_triggers,
    evt21,
    frame_of,
    write_ecf,
)
from written_sequence import write_sequence

SIZE = (240, 180)


@dataclass(frozen=True)
class Target:
    """A reader.

    ``make`` writes a file to begin with, or several, into a folder; ``read`` reads a mutant and raises AssertionError
    where what comes out breaks a promise. ``harmful`` writes files that must be refused, and whose mutants are read
    like those of the others. ``allowed`` are the errors that a reader may raise, ``warns`` is how those of
    its warnings begin that have no class of their own.
    """

    make: Callable[[Path], list[Path]]
    read: Callable[[Path, random.Random], None]
    allowed: tuple[type[Exception], ...] = (davis_rs.DecodeError,)
    warns: tuple[str, ...] = ()
    harmful: Callable[[Path], list[Path]] = lambda _: []


def some_events(count: int = 300) -> Any:
    """Events of a small sequence."""
    rng = np.random.default_rng(0)
    events = np.zeros(count, davis_rs.EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, 20_000, count))
    events["x"], events["y"] = rng.integers(0, SIZE[0], count), rng.integers(0, SIZE[1], count)
    events["p"] = rng.integers(0, 2, count)
    return events


def _written(suffix: str, format: str | None = None, **options: Any) -> Callable[[Path], list[Path]]:
    def make(folder: Path) -> list[Path]:
        path = folder / f"seed{suffix}"
        with davis_rs.open_writer(path, SIZE, format, **options) as writer:
            for part in np.array_split(some_events(), 5):
                writer.write(part)
        return [path]

    return make


def _saved(save: Callable[..., None]) -> Callable[[Path], list[Path]]:
    def make(folder: Path) -> list[Path]:
        path = folder / "seed.npz"
        save(path, events=some_events())
        return [path]

    return make


def _unfinished_bag(folder: Path) -> list[Path]:
    [path] = _written(".bag", compression="lz4")(folder)
    content = bytearray(path.read_bytes())
    place = content.index(b"index_pos=") + len(b"index_pos=")
    struct.pack_into("<Q", content, place, 0)
    path.write_bytes(content)
    return [path]


def _bag_database(folder: Path) -> list[Path]:
    path = folder / "seed"
    with davis_rs.open_writer(path, SIZE, "ros2") as writer:
        writer.write(some_events())
    return [path / "seed.db3"]


def _harmful_databases(folder: Path) -> list[Path]:
    made = [database(folder / f"harmful{k}.db3", *statements) for k, statements in enumerate(PROGRAMS.values())]
    return [*made, in_circles(folder / "circles.db3")]


def _gzip_hdf5(folder: Path) -> list[Path]:
    import h5py

    events = some_events()
    paths = [folder / "seed.h5", folder / "one_chunk.h5"]
    for path, chunk in zip(paths, (100, 1 << 16), strict=True):
        with h5py.File(path, "w") as file:
            for name in "txyp":
                column = {"data": events[name], "maxshape": (None,), "chunks": (chunk,)}
                file.create_dataset(f"events/{name}", **column, compression="gzip", shuffle=chunk == 100)
            file.attrs["sensor_resolution"] = [180, 240]
    return paths


def read_event_file(path: Path, rng: random.Random) -> None:
    """All of it, a slice of it, its summary, what lies next to the events, or any of them by number."""
    kind = rng.randrange(6)
    if kind == 0:
        summarize_events(path)
        return
    start = rng.choice([None, 5_000]) if kind < 3 else None
    stop = rng.choice([None, 15_000]) if kind < 3 else None
    policies: dict[str, Any] = rng.choice([{}, {}, {"backward": "drop"}, {"outside": "drop", "backward": "drop"}])
    with davis_rs.open_reader(path, **policies) as reader:
        events = reader.read(start_us=start, stop_us=stop)
        width, height = reader.size or (65_536, 65_536)
        t = events["t"]
        assert not (t < 0).any(), "times before 0"
        assert not (t[1:] < t[:-1]).any(), "times that go back"
        assert not (events["p"] > 1).any(), "a polarity above 1"
        assert not ((events["x"] >= width) | (events["y"] >= height)).any(), "pixels outside"
        if kind == 5:
            np.testing.assert_array_equal(np.concatenate([events[:0], *reader.iter(64)]), events)
        if kind == 4 and isinstance(reader, RecordedParts):
            for _, image in reader.images():
                assert reader.size is None or image.shape == (height, width), "an image that is not the sensor's"
            list(reader.imu())
        if kind == 3 and reader.format in ("aedat2", "aedat3"):
            access = RandomAccess(path)
            np.testing.assert_array_equal(access.read(0, access.events), events)


def _evt21(folder: Path) -> list[Path]:
    path = folder / "e.raw"
    path.write_bytes(evt21(many(50)))
    return [path]


def _ecf(folder: Path) -> list[Path]:
    return [write_ecf(folder / "e.h5", many(50), chunk=16)]


def _aedat2(folder: Path) -> list[Path]:
    words = [aedat2_event(t % 240, t % 180, t % 2) for t in range(50)] + aedat2_imu(range(7)) + [0x402]
    path = folder / "seed.aedat"
    path.write_bytes(aedat2([(word, t) for t, word in enumerate(words)]))
    return [path]


def _aedat3(folder: Path) -> list[Path]:
    path = folder / "seed.aedat"
    path.write_bytes(
        aedat3(
            aedat3_packet(1, [aedat3_event(t, t, t, 1) for t in range(20)]),
            aedat3_packet(0, [aedat3_special(1, 2)]),
            aedat3_packet(2, [aedat3_frame(frame_of(5, 3))] * 2),
            aedat3_packet(3, [aedat3_imu(1, [1.0] * 7)] * 2),
        )
    )
    return [path]


def _aedat4(folder: Path) -> list[Path]:
    paths = []
    for compression in (0, 1, 3):
        paths.append(folder / f"seed{compression}.aedat4")
        paths[-1].write_bytes(
            aedat4(
                (0, aedat4_events(some_events(30))),
                (1, aedat4_frame(frame_of(5, 3))),
                (2, aedat4_imu([(1, [1.0] * 7)] * 3)),
                (3, aedat4_triggers([(1, 0), (2, 1)])),
                compression=compression,
            )
        )
    return paths


def read_recording(path: Path, _: random.Random) -> None:
    """With all that can be asked of it."""
    recording = davis_rs.read_recording(path)
    width, height = recording.width, recording.height
    events = recording.events
    assert not ((events["x"] >= width) | (events["y"] >= height)).any(), "pixels outside"
    assert not (events["p"] > 1).any(), "a polarity above 1"


def _trajectory(folder: Path) -> list[Path]:
    rows = [(0.01 * k, 0.1 * k, 0.0, 1.0, 0.0, 0.0, np.sin(0.01 * k), np.cos(0.01 * k)) for k in range(30)]
    lines = [" ".join(f"{value:.9f}" for value in row) for row in rows]
    (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")
    (folder / "tum.txt").write_text("# timestamp tx ty tz qx qy qz qw\n" + "\n".join("14" + line for line in lines))
    commas = ["timestamp, x, y, z, qx, qy, qz, qw", *(f"{round(row[0] * 1e9)}, " + ", ".join(
        f"{value:.9f}" for value in row[1:]) for row in rows)]  # fmt: skip
    (folder / "esim.csv").write_text("\n".join(commas))
    return [folder / "groundtruth.txt", folder / "tum.txt", folder / "esim.csv"]


def read_trajectory(path: Path, _: random.Random) -> None:
    """And ask it for a pose and its speed."""
    trajectory = davis_rs.read_trajectory(path)
    assert np.isfinite(trajectory.pose(trajectory.duration_s / 2).matrix).all(), "a pose that is not finite"


def _calibration(folder: Path) -> list[Path]:
    path = folder / "calib.txt"
    path.write_text(davis_rs.load_camera("davis240c").to_calib())
    return [path]


def read_calibration(path: Path, _: random.Random) -> None:
    """A camera."""
    davis_rs.Camera.from_calib(path)


def _plan(folder: Path) -> list[Path]:
    path = folder / "plan.yaml"
    path.write_text(
        "seed: 7\nsequences: 20\nscene: {choice: [three_planes, fence]}\nduration: {uniform: [0.1, 0.2]}\n"
        "contrast_threshold: &c {normal: [0.2, 0.03], min: 0.1, max: 0.3}\ncontrast_threshold_off: *c\n"
        "motion:\n  kind: hand_held\n  degrees_of_freedom: 6dof\n  top_speed_m_s: 1\n  top_rate_deg_s: 60\n"
        "  duration_s: 0.5\n  reach_m: {log_uniform: [0.5, 2]}\n"
        "effects: {leak_rate: 0.1, shot_noise: {uniform: [0.1, 1]}}\n"
    )
    return [path]


def read_plan(path: Path, _: random.Random) -> None:
    """And draw its first sequences."""
    plan = load_sequence_plan(path)
    for index in range(min(3, plan.sequences)):
        plan.parameters(index)


def _sensor(folder: Path) -> list[Path]:
    path = folder / "sensor.yaml"
    path.write_text(sensor_yaml(preset_file("davis240c")))
    return [path]


def read_sensor(path: Path, _: random.Random) -> None:
    """What is taken has effects, and is written and read back alike."""
    sensor = read_sensor_file(path)
    sensor.parameters.effects(1000.0)
    path.write_text(sensor_yaml(sensor))
    assert read_sensor_file(path) == sensor


def _davis(folder: Path) -> list[Path]:
    path = folder / "seed.davis"
    with RawWriter(path, DESCRIPTION, started=datetime(2026, 1, 1, tzinfo=timezone.utc)) as writer:
        writer.write(davis_rs.Encoder("DAVIS240C").encode(some_events()))
    return [path]


def read_davis(path: Path, _: random.Random) -> None:
    """And decode it."""
    recording = RawRecording(path)
    decoder = recording.decoder()
    for chunk in recording.chunks():
        decoder.push(chunk)


def _gltf(folder: Path) -> list[Path]:
    """With all that is read: a texture, colours, copies, a light, a camera, an animation; most of it in the JSON."""
    gltf = Gltf(extensionsRequired=["KHR_lights_punctual"])
    texture = gltf.texture({"uri": "data:image/png;base64," + _PNG}, {"wrapS": 33071, "wrapT": 33071})
    texture |= {"extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}  # type: ignore[dict-item]
    gloss = {"diffuseFactor": [1, 0.5, 0.5, 1], "diffuseTexture": texture}
    emits = {"emissiveFactor": [1, 0.5, 0], "emissiveTexture": texture}
    strength = {"emissiveStrength": 2}
    extensions = {"KHR_materials_pbrSpecularGlossiness": gloss, "KHR_materials_emissive_strength": strength}
    clear = {"KHR_materials_transmission": {"transmissionFactor": 0.9}, "KHR_materials_ior": {"ior": 1.4}}
    volume = {"thicknessFactor": 0.1, "attenuationDistance": 2, "attenuationColor": [0.5, 0.9, 0.2]}
    pane = gltf.material("pane", more={"extensions": {**clear, "KHR_materials_volume": volume}})
    gltf.node(mesh=quad(gltf, material=pane))
    bumps: dict[str, Any] = {"normalTexture": {**texture, "scale": 0.5}}
    more = {"extensions": extensions, "alphaMode": "MASK", **bumps, **emits}
    paint = gltf.material(baseColorTexture=texture, more=more)
    body = gltf.node(mesh=quad(gltf, uv=UV, material=paint), name="body")
    gltf.node(mesh=quad(gltf, uv=UV, material=paint, colours=np.linspace(0, 1, 12).reshape(4, 3)))
    child = gltf.node(root=False, mesh=quad(gltf, colours=np.full((4, 3), 0.5)), scale=[1, 2, 3])
    gltf.node(children=[child], matrix=np.eye(4).ravel().tolist())
    places = {"TRANSLATION": gltf.array(np.eye(3)), "ROTATION": gltf.array(np.tile([0, 0.6, 0, 0.8], (3, 1)))}
    strip = {"attributes": {"POSITION": 0}, "indices": gltf.array([0, 1, 3, 2], "u2"), "mode": 5}
    copied = gltf.add("meshes", {"primitives": [strip]})
    gltf.node(mesh=copied, extensions={"EXT_mesh_gpu_instancing": {"attributes": places}})
    lens = {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}
    camera = gltf.node(camera=gltf.add("cameras", lens), translation=[0, 0, 3])
    gltf.animate(camera, "rotation", [0.0, 1.0], np.array([[0, 0, 0, 1], [0, 0.6, 0, 0.8]]))
    gltf.animate(body, "translation", [0.0, 1.0], np.zeros((6, 3)), "CUBICSPLINE")
    soft = quad(gltf)
    soft_part = gltf.document["meshes"][soft]["primitives"][0]
    joints = {
        "JOINTS_0": gltf.array(np.tile([0, 1, 0, 0], (4, 1)), "u1"),
        "WEIGHTS_0": gltf.array(np.full((4, 4), 0.25)),
    }
    soft_part["attributes"] |= joints
    soft_part["targets"] = [{"POSITION": gltf.array(CORNERS), "NORMAL": gltf.array(CORNERS)}]
    bound = gltf.array(np.tile(np.eye(4).ravel(), (2, 1)))
    skin = gltf.add("skins", {"joints": [body, child], "inverseBindMatrices": bound})
    walker = gltf.node(mesh=soft, skin=skin, weights=[0.5])
    gltf.animate(walker, "weights", [0.0, 1.0], [0.0, 1.0])
    gltf.light({"type": "spot", "intensity": 100.0, "spot": {"outerConeAngle": 0.5}}, translation=[0, 0, 2])
    return [gltf.save(folder / "seed.gltf"), gltf.save(folder / "embedded.gltf"), _zeros(folder / "zeros.gltf")]


def _zeros(path: Path) -> Path:
    """Accessors without data, nodes without anything, and an image whose header may claim any size."""
    gltf = Gltf()
    numbers = [gltf.add("accessors", {"componentType": 5126, "type": "VEC3", "count": 99}) for _ in range(20)]
    primitives = [{"attributes": {"POSITION": number}} for number in numbers]
    gltf.node(mesh=gltf.add("meshes", {"primitives": primitives}))
    gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material(baseColorTexture=gltf.texture({"uri": "seed.png"}))))
    for _ in range(20):
        gltf.node()
    (path.parent / "seed.png").write_bytes(base64.b64decode(_PNG))
    return gltf.save(path)


def _glb(folder: Path) -> list[Path]:
    _gltf(folder)
    gltf = Gltf()
    gltf.node(mesh=quad(gltf, uv=UV, normals=CORNERS, material=gltf.material()))
    packed = packed_square("KHR_meshopt_compression")
    return [gltf.save(folder / "seed.glb"), packed.save(folder / "packed.glb"), _with_ktx2(folder / "image.glb")]


def _with_ktx2(path: Path) -> Path:
    """A texture in Basis Universal, compressed once more and turned."""
    blocks = uastc(np.arange(16, dtype=np.uint8).reshape(2, 2, 4))
    metadata = [("KTXorientation", "ru"), ("KTXswizzle", "bgra")]
    image = ktx2(8, 8, zstandard.compress(blocks), scheme=2, unpacked=len(blocks), metadata=metadata)
    gltf = Gltf(extensionsRequired=["KHR_texture_basisu"])
    source = gltf.add("images", {"bufferView": gltf.view(image), "mimeType": "image/ktx2"})
    texture = {"index": gltf.add("textures", {"extensions": {"KHR_texture_basisu": {"source": source}}})}
    gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material(baseColorTexture=texture)))
    return gltf.save(path)


def _obj(folder: Path) -> list[Path]:
    """Two materials, one of them with a texture."""
    (folder / "seed.png").write_bytes(base64.b64decode(_PNG))
    (folder / "seed.mtl").write_text(
        "newmtl a\nKd 1 0.5 0\nnewmtl b\nmap_Kd seed.png\nmap_d seed.png\nmap_Ke seed.png\nKe 1 2 3\n"
    )
    path = folder / "seed.obj"
    path.write_text(
        "mtllib seed.mtl\nmtllib seed.mtl\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nv 1 1 0 1 1 1\nvt 0 0\nvt 1 0\n"
        "vt 0 1\nvn 0 0 1\nusemtl a\nf 1 2 4 3\nusemtl b\nf 1/1/1 2/2/1 3/3/1\nf -1/1 -2/2 -3/3\nl 1 2\n"
    )
    return [path]


def _ply(folder: Path) -> list[Path]:
    """Text and binary, with a texture, lists of two lengths, and strips."""
    (folder / "seed.png").write_bytes(base64.b64decode(_PNG))
    header = (
        "ply\nformat {} 1.0\ncomment TextureFile seed.png\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nproperty float s\nproperty float t\nelement face 2\n"
        "property list uchar int vertex_indices\nelement tristrips 1\nproperty list int int vertex_indices\n"
        "end_header\n"
    )
    corners = [(0, 0, 0, 0, 0), (1, 0, 0, 1, 0), (0, 1, 0, 0, 1), (1, 1, 0, 1, 1)]
    faces, strip = [(0, 1, 2), (0, 1, 3, 2)], (0, 1, 2, 3, -1, 2, 1, 0)
    text, binary = folder / "seed.ply", folder / "binary.ply"
    rows = [*corners, *((len(face), *face) for face in faces), (len(strip), *strip)]
    text.write_text(header.format("ascii") + "".join(" ".join(map(str, row)) + "\n" for row in rows))
    body = b"".join(struct.pack("<5f", *row) for row in corners)
    body += b"".join(struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces)
    body += struct.pack(f"<i{len(strip)}i", len(strip), *strip)
    binary.write_bytes(header.format("binary_little_endian").encode() + body)
    return [text, binary]


def _pictures(*kinds: str) -> Callable[[Path], list[Path]]:
    """Grey, colour, 16 bits."""

    def make(folder: Path) -> list[Path]:
        import cv2

        rng = np.random.default_rng(0)
        paths = []
        for kind in kinds:
            images = [rng.integers(0, 256, shape, np.uint8) for shape in ((9, 7), (9, 7, 3))]
            if kind in ("png", "tif"):
                images.append(rng.integers(0, 65536, (9, 7, 3), np.uint16))
            for number, image in enumerate(images):
                paths.append(folder / f"seed{number}.{kind}")
                cv2.imwrite(str(paths[-1]), image)
        return paths

    return make


def _exr(folder: Path) -> list[Path]:
    write_exr(folder / "seed.exr", {"RGB": np.ones((5, 4, 3), np.float32)})
    return [folder / "seed.exr"]


def read_picture(path: Path, _: random.Random) -> None:
    """As a frame."""
    image = read_frame_image(path)
    assert image.size > 0, "an image without pixels"


_PNG = (
    "iVBORw0KGgoAAAANSUhEUgAAAAIAAAACCAYAAABytg0kAAAAG0lEQVR4nGM4ESX3X+5E1H+GKLkT/3/9EmEAAE+zCMZgmdWgAAAAAElFTkSuQmCC"
)
"""2 x 2 texels, one of them clear."""


def read_scene(path: Path, _: random.Random) -> None:
    """And ask its camera and what moves where they are."""
    scene = davis_rs.load_scene(path)
    for trajectory in (scene.path, *scene.objects.values()) if scene.trajectory is not None else ():
        assert np.isfinite(trajectory.pose(trajectory.duration_s / 2).matrix).all(), "a pose that is not finite"
        assert np.isfinite(trajectory.velocities([0.0])).all(), "a speed that is not finite"
    for deformation in scene.deformations.values():
        middle = np.array([deformation.duration_s / 2])
        (mesh,), (velocities,) = deformation.meshes(middle), deformation.velocities(middle)
        for values in (mesh.positions, velocities, deformation.box(), deformation.fastest(middle)):
            assert np.isfinite(values).all(), "a vertex that is not finite"


_XML = """<?xml version="1.0" encoding="utf-8"?>
<scene><default name="n" value="30"/><integrator type="bdpt"/><path value="."/>
<sensor type="perspective"><animation name="toWorld">
<transform time="0"><lookAt origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
<transform time="0.5"><rotate y="1" angle="$n"/><translate x="0.5"/></transform></animation></sensor>
<bsdf type="phong" id="paint"><float name="exponent" value="$n"/>
<srgb name="diffuseReflectance" value="#7f331a"/></bsdf>
<bsdf type="mixturebsdf" id="mix"><string name="weights" value="0.5 0.2"/><ref id="paint"/><bsdf type="hk"/></bsdf>
<bsdf type="coating" id="coat"><float name="intIOR" value="1.7"/><bsdf type="diffuse"/></bsdf>
<bsdf type="ward"><float name="alphaU" value="0.1"/><float name="alphaV" value="0.3"/></bsdf>
<bsdf type="disneybsdf"><float name="specular" value="0.5"/><float name="eta" value="1.5"/></bsdf>
<bsdf type="roughdiffuse"><float name="alpha" value="0.5"/></bsdf>
<bsdf type="normalmap"><string name="filename" value="bumps.png"/></bsdf>
<medium type="homogeneous"><rgb name="sigmaA" value="1, 2, 3"/><rgb name="sigmaS" value="1, 0, 3"/></medium>
<shape type="cube"><animation name="toWorld"><transform time="0"><scale x="2" y="1" z="0.5"/></transform>
<transform time="1"><matrix value="2 0 0 1 0 1 0 0 0 0 0.5 0 0 0 0 1"/></transform></animation><ref id="mix"/></shape>
<include filename="part.xml"/></scene>
"""


def _mitsuba(folder: Path) -> list[Path]:
    """With all that is written anew: former names and materials, and what moves."""
    path = folder / "seed.xml"
    path.write_text(_XML)
    return [path]


def read_mitsuba(path: Path, rng: random.Random) -> None:
    """And write it anew, up to where Mitsuba would make a scene of it."""
    notes: list[str] = []
    file = read_scene_file(XmlFile(path, {}))
    rewrite(file, notes)
    with variant(SCALAR) as (mi, _):
        for motion in take_motions(file, mi, notes):
            assert np.isfinite(motion.poses).all(), "a pose that is not finite"
            turns = motion.poses[:, :3, :3]
            if motion.tag == "shape":
                assert np.abs(turns @ turns.swapaxes(1, 2) - np.eye(3)).max() < 1e-6, "a body that is not rigid"
        translate(file, notes)
        if rng.random() < 0.5:
            make_grey(file, mi, notes)
    text, places = written(file.root)
    assert len(places) == text.count("\n") + 1, "an element without a place"
    ElementTree.fromstring(text)


DATASET = {
    "meta": "meta.json",
    "groundtruth": "groundtruth.txt",
    "images": "images.txt",
    "calib": "calib.txt",
    "events": "events.txt",
    "frame": "images/frame_00000000.png",
    "luma": "luma/frame_00000000.exr",
}
"""Files of a dataset, one of which is a mutant while the folder is checked."""


def _dataset_file(name: str) -> Callable[[Path], list[Path]]:
    def make(folder: Path) -> list[Path]:
        write_sequence(folder / "dataset")
        return [folder / "dataset" / name]

    return make


def _check_with(name: str) -> Callable[[Path, random.Random], None]:
    def read(path: Path, _: random.Random) -> None:
        replaced = path.parent / "dataset" / name
        whole = replaced.read_bytes()
        replaced.write_bytes(path.read_bytes())
        try:
            str(check_dataset(path.parent / "dataset"))
        finally:
            replaced.write_bytes(whole)

    return read


FUZZED_FILES: dict[str, Callable[[Path], list[Path]]] = {
    "text": _written(".txt"),
    "npy": _written(".npy"),
    "npz": _written(".npz"),
    "npz-deflated": _saved(np.savez_compressed),
    "evt2": _written(".raw", "evt2"),
    "evt21": _evt21,
    "evt3": _written(".raw", "evt3"),
    "aedat4": _written(".aedat4", compression="none"),
    "aedat4-lz4": _written(".aedat4"),
    "aedat4-zstd": _written(".aedat4", compression="zstd"),
    "dsec": _written(".h5"),
    "dsec-gzip": _gzip_hdf5,
    "e2vid": _written(".h5", "e2vid"),
    "mvsec": _written(".h5", "mvsec"),
    "ecf": _ecf,
    "parquet": _written(".parquet"),
    "bag": _written(".bag"),
    "bag-bz2": _written(".bag", compression="bz2"),
    "bag-lz4": _written(".bag", compression="lz4"),
    "bag-unfinished": _unfinished_bag,
    "ros2": _written(".mcap"),
    "ros2-database": _bag_database,
    "aedat2": _aedat2,
    "aedat3": _aedat3,
    "aedat4-frames": _aedat4,
    "camera": _davis,
}

HARMFUL: dict[str, Callable[[Path], list[Path]]] = {
    "ros2-database": _harmful_databases,
}
"""Of event files: what must be refused, see :class:`Target`."""


def _baked_light(folder: Path) -> list[Path]:
    divisions = np.array([[1, -1], [0, 2]])
    texels = [np.ones((texel_count(layouts_of(divisions)), 3), np.float32)]
    bumpy = np.array([True, False])
    vectors = [np.ones((texel_count(vector_layouts_of(divisions, bumpy)), 9), np.float32)]
    maps = LightMaps(divisions, texels, bumpy, vectors, np.zeros(1), 0.01, 0.0, 40, (16, 64), True, 1.5)
    (folder / "seed.light").write_bytes(cache._packed(maps))
    return [folder / "seed.light"]


def read_baked_light(path: Path, _: random.Random) -> None:
    """A mutant whose checksum is right: whoever can write the file can write that, too."""
    content = path.read_bytes()[32:]
    maps = cache._unpacked(hashlib.sha256(content).digest() + content)
    two_sided, bumpy = np.array([False, True]), np.array([True, False])
    check_maps(maps, two_sided=two_sided, bumpy=bumpy, lights=1, tests=np.zeros(1))
    assert np.isfinite(maps.texels[0]).all(), "light that is not finite"


_OF_SCENES = (davis_rs.DecodeError, FileNotFoundError)
_OF_PILLOW = (
    "Corrupt EXIF data",
    "Truncated File Read",
    "Metadata Warning",
    "Tag data larger than file",
    "Image appears to be a malformed MPO",
)
_SCENE_WARNINGS = ("/",)
"""A scene's warnings begin with its file."""

TARGETS: dict[str, Target] = {
    **{
        name: Target(make, read_event_file, harmful=HARMFUL.get(name, lambda _: []))
        for name, make in FUZZED_FILES.items()
    },
    "recording-aedat2": Target(_aedat2, read_recording),
    "recording-aedat3": Target(_aedat3, read_recording),
    "recording-aedat4": Target(_aedat4, read_recording),
    "trajectory": Target(_trajectory, read_trajectory, warns=("bridged ",)),
    "calibration": Target(_calibration, read_calibration),
    "sensor": Target(_sensor, read_sensor),
    "plan": Target(_plan, read_plan, allowed=(ValueError, FileNotFoundError)),
    "davis": Target(_davis, read_davis),
    "baked-light": Target(_baked_light, read_baked_light, allowed=(ValueError,)),
    "gltf": Target(_gltf, read_scene, allowed=_OF_SCENES, warns=_SCENE_WARNINGS),
    "glb": Target(_glb, read_scene, allowed=_OF_SCENES, warns=_SCENE_WARNINGS),
    "mitsuba": Target(_mitsuba, read_mitsuba, allowed=(davis_rs.DecodeError, FileNotFoundError)),
    "obj": Target(_obj, read_scene, allowed=(ValueError, FileNotFoundError), warns=_SCENE_WARNINGS),
    "ply": Target(_ply, read_scene, allowed=(ValueError, FileNotFoundError), warns=_SCENE_WARNINGS),
    "frame-png": Target(_pictures("png"), read_picture, warns=_OF_PILLOW),
    "frame-tiff": Target(_pictures("tif"), read_picture, warns=_OF_PILLOW),
    "frame-jpeg": Target(_pictures("jpg", "bmp"), read_picture, warns=_OF_PILLOW),
    "frame-exr": Target(_exr, read_picture),
    **{f"check-{key}": Target(_dataset_file(name), _check_with(name), allowed=()) for key, name in DATASET.items()},
}
