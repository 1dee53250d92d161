"""Images in KTX2 files: Basis Universal and plain bytes, and glTF files that have them."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import zstandard

from davis_rs import DecodeError, Scene, load_scene
from davis_rs import _core as core
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs._util.budget import VARIABLE
from gltf_files import UV, Gltf, png, quad
from ktx2_files import ETC1S, etc1s_shared, etc1s_slice, ktx2, uastc

Image = npt.NDArray[np.uint8]

COLOURS = np.array([[[250, 3, 7, 255], [10, 240, 30, 128]], [[0, 0, 200, 0], [90, 91, 92, 93]]], np.uint8)
"""Of 2 x 2 blocks."""
TEXELS = COLOURS.repeat(4, 0).repeat(4, 1)
"""What they decode to."""

ENDPOINTS = [(31, 0, 0, 0), (0, 31, 4, 3)]
SELECTORS = [[0] * 16, [0, 1, 2, 3] * 4]
BLOCKS = [[(0, 0), (1, 1), (1, 0)], [(0, 1), (1, 0), (0, 0)], [(1, 1), (1, 1), (0, 1)]]
OPACITY = [[(0, 0), (1, 1), (1, 0)]] * 3
CONTRASTS = {0: (-8, -2, 2, 8), 3: (-42, -13, 13, 42)}
"""What the numbers 0 to 3 add to a colour, by the table of an endpoint; source: ETC1."""


def decode(data: bytes) -> Image:
    return core.decode_ktx2(np.frombuffer(data, np.uint8))


def etc1s(channels: tuple[int, ...], **more: Any) -> bytes:
    slices = [etc1s_slice(blocks, ENDPOINTS, SELECTORS) for blocks in (BLOCKS, OPACITY)[: len(channels)]]
    shared = etc1s_shared(ENDPOINTS, SELECTORS, slices)
    level = b"".join(slices)
    return ktx2(10, 11, level, model=ETC1S, channels=channels, scheme=1, unpacked=0, shared=shared, **more)


def expected(blocks: list[list[tuple[int, int]]]) -> Image:
    """The colours (11, 10, 3) of ETC1S blocks, by its rule."""
    rgb = np.zeros((12, 12, 3), np.int64)
    for row, numbers in enumerate(blocks):
        for column, (endpoint, selector) in enumerate(numbers):
            *base, contrast = ENDPOINTS[endpoint]
            eight_bits = np.array([number << 3 | number >> 2 for number in base])
            steps = np.array(CONTRASTS[contrast])[np.reshape(SELECTORS[selector], (4, 4))]
            rgb[4 * row : 4 * row + 4, 4 * column : 4 * column + 4] = eight_bits + steps[..., None]
    return rgb.clip(0, 255).astype(np.uint8)[:11, :10]


def test_uastc_is_decoded() -> None:
    """Also where the image ends within blocks, and where the level is compressed once more."""
    blocks = uastc(COLOURS)
    assert np.array_equal(decode(ktx2(8, 8, blocks, channels=(3,))), TEXELS)
    assert np.array_equal(decode(ktx2(7, 5, blocks, channels=(3,))), TEXELS[:5, :7])
    packed = zstandard.compress(blocks)
    assert np.array_equal(decode(ktx2(8, 8, packed, channels=(3,), scheme=2, unpacked=len(blocks))), TEXELS)


def test_etc1s_is_decoded() -> None:
    colours = decode(etc1s((0,)))
    assert np.array_equal(colours[..., :3], expected(BLOCKS))
    assert (colours[..., 3] == 255).all()
    both = decode(etc1s((0, 15)))
    assert np.array_equal(both[..., :3], expected(BLOCKS))
    assert np.array_equal(both[..., 3], expected(OPACITY)[..., 1]), "the green of the second slice is the opacity"


def test_two_channels_are_red_and_green() -> None:
    """They are decoded as a grey with opacity, which glTF does not mean."""
    both = decode(etc1s((3, 4)))
    assert np.array_equal(both[..., 0], expected(BLOCKS)[..., 0])
    assert np.array_equal(both[..., 1], expected(OPACITY)[..., 1])
    assert (both[..., 2:] == [0, 255]).all()
    texels = decode(ktx2(8, 8, uastc(COLOURS), channels=(5,)))
    assert np.array_equal(texels[..., :2], TEXELS[..., [0, 3]])
    assert (texels[..., 2:] == [0, 255]).all()


PLAIN = np.arange(24, dtype=np.uint8).reshape(2, 3, 4) * 10


@pytest.mark.parametrize(
    ("vulkan", "order"),
    [(9, [0]), (15, [0]), (22, [0, 1]), (23, [0, 1, 2]), (29, [0, 1, 2]), (30, [2, 1, 0]), (43, [0, 1, 2, 3]),
     (44, [2, 1, 0, 3])],
)  # fmt: skip
def test_plain_bytes_are_read(vulkan: int, order: list[int]) -> None:
    level = PLAIN[..., order].tobytes()
    shown = np.array([0, 0, 0, 255], np.uint8) * np.ones((2, 3, 1), np.uint8)
    shown[..., order] = PLAIN[..., order]
    for scheme, stored in ((0, level), (2, zstandard.compress(level))):
        data = ktx2(3, 2, stored, vulkan=vulkan, model=1, channels=order, scheme=scheme, unpacked=len(level))
        assert np.array_equal(decode(data), shown)


@pytest.mark.parametrize(
    ("orientation", "texels"),
    [("rd", PLAIN), ("ru", PLAIN[::-1]), ("ld", PLAIN[:, ::-1]), ("lu", PLAIN[::-1, ::-1])],
)
def test_texels_are_where_the_file_says(orientation: str, texels: Image) -> None:
    data = ktx2(
        3, 2, PLAIN.tobytes(), vulkan=37, model=1, metadata=[("KTXwriter", "x"), ("KTXorientation", orientation)]
    )
    assert np.array_equal(decode(data), texels)


def test_channels_are_what_the_file_says() -> None:
    data = ktx2(3, 2, PLAIN.tobytes(), vulkan=37, model=1, metadata=[("KTXswizzle", "bg01")])
    assert np.array_equal(
        decode(data), np.dstack([PLAIN[..., 2], PLAIN[..., 1], 0 * PLAIN[..., 0], 0 * PLAIN[..., 0] + 255])
    )


@pytest.mark.parametrize(("transfer", "name"), [(0, ""), (1, "linear"), (2, "srgb")])
def test_size_and_encoding_are_known_before_texels_are_decoded(transfer: int, name: str) -> None:
    data = ktx2(70, 50, b"", transfer=transfer)
    assert core.inspect_ktx2(np.frombuffer(data, np.uint8)) == (70, 50, name)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "BC7": ({"vulkan": 146}, r"texels in BC \(Vulkan's format 146\) are not read: export the image as Basis Universal"),
    "ASTC": ({"vulkan": 158}, r"texels in ASTC \(Vulkan's format 158\) are not read"),
    "floats": ({"vulkan": 97}, "texels in Vulkan's format 97 are not read"),
    "UASTC HDR": ({"model": 167}, "texels in the colour model 167 are not read"),
    "zlib": ({"scheme": 3}, "compressed by scheme 3 are not read"),
    "ETC1S without codebooks": ({"model": ETC1S}, "compressed by scheme 0 are not read"),
    "short": ({"level": b"1234"}, r"the finest level must have 64 bytes, got 4 \(byte 148\)"),
    "no frame": ({"scheme": 2}, "the finest level must have 64 bytes, got a frame of Zstandard that cannot be"),
    "longer frame": ({"level": zstandard.compress(bytes(65)), "scheme": 2}, "that cannot be unpacked to it"),
    "shorter frame": ({"level": zstandard.compress(bytes(63)), "scheme": 2}, "must have 64 bytes, got 63"),
    "block of no mode": ({"level": bytes([0x45] + [0] * 15) * 4}, "blocks of Uastc break a rule of Basis Universal"),
    "premultiplied": ({"flags": 1}, "colours are multiplied by the opacity"),
    "transfer": ({"transfer": 5}, "got the transfer function 5"),
    "no width": ({"width": 0}, "must have one image with a width and a height"),
    "vast": ({"width": 20000, "height": 20000}, "an image may have 268435456 texels, got 20000 x 20000"),
    "orientation": ({"metadata": [("KTXorientation", "xy")]}, "KTXorientation must be one of rd, ru, ld, lu"),
    "swizzle": ({"metadata": [("KTXswizzle", "rgbx")]}, "KTXswizzle must be four of the letters"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_read_is_refused_with_the_rule(name: str) -> None:
    changes, rule = REFUSED[name]
    given = {"width": 8, "height": 8, "level": uastc(COLOURS), "channels": (3,), **changes}
    with pytest.raises(DecodeError, match=rule):
        decode(ktx2(**given))


@pytest.mark.parametrize("samples", [0, 2])
def test_a_descriptor_has_as_many_samples_as_it_says(samples: int) -> None:
    data = bytearray(ktx2(8, 8, uastc(COLOURS), channels=(3,)))
    data[114:116] = (24 + 16 * samples).to_bytes(2, "little")
    with pytest.raises(DecodeError, match=r"must have a basic descriptor with a sample \(byte 104\)"):
        decode(bytes(data))


def test_damaged_files_are_refused_or_give_an_image() -> None:
    """No other error; files that are cut short are always refused."""
    blocks = uastc(COLOURS)
    packed = ktx2(8, 8, zstandard.compress(blocks), channels=(3,), scheme=2, unpacked=len(blocks))
    random = np.random.RandomState(12)
    for data in (ktx2(8, 8, blocks, channels=(3,)), packed, etc1s((0, 15))):
        for length in range(len(data)):
            with pytest.raises(DecodeError, match=r".+"):
                decode(data[:length])
        for _ in range(300):
            damaged = bytearray(data)
            for at in random.randint(12, len(data), 3):
                damaged[at] = random.randint(0, 256)
            file = np.frombuffer(bytes(damaged), np.uint8)
            with suppress(DecodeError):
                width, height, _ = core.inspect_ktx2(file)
                if width * height < 10**6:
                    assert core.decode_ktx2(file).shape == (height, width, 4)


def with_image(image: bytes, use: str = "baseColorTexture", factor: str = "", **texture: Any) -> Gltf:
    """A square with a KTX2 image; ``texture`` has more of its texture, ``factor`` is what multiplies it."""
    gltf = Gltf(extensionsUsed=["KHR_texture_basisu"], extensionsRequired=["KHR_texture_basisu"])
    source = gltf.add("images", {"bufferView": gltf.view(image), "mimeType": "image/ktx2"})
    gltf.add("textures", {"extensions": {"KHR_texture_basisu": {"source": source}}, **texture})
    info: Any = {use: {"index": 0}}
    surface = info if use in ("baseColorTexture", "metallicRoughnessTexture") else {}
    more = {} if surface else info
    if factor:
        (surface if surface else more)[factor] = 1.0 if factor == "metallicFactor" else [1.0, 1.0, 1.0]
    gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material(more=more, **surface)))
    return gltf


def saved(gltf: Gltf, folder: Path) -> Scene:
    return load_scene(gltf.save(folder / "scene.glb"))


def texels_of(scene: Scene) -> Image:
    """The colours of the one surface."""
    with variant(SCALAR) as (mi, _):
        (shape,) = load_scene_source(scene.source(), mi).shapes()
        return np.array(mi.traverse(shape.bsdf())["brdf_0.reflectance.data"])


def test_gltf_files_have_such_textures(tmp_path: Path) -> None:
    """As with any other image of the same texels; nothing is lost."""
    opaque = COLOURS.copy()
    opaque[..., 3] = 255
    scene = saved(with_image(ktx2(8, 8, uastc(opaque))), tmp_path)
    assert np.array_equal(texels_of(scene), TEXELS[..., :3])
    assert scene.lost_looks == ()


def test_an_image_of_the_usual_kind_is_read_instead(tmp_path: Path) -> None:
    gltf = with_image(b"no such image", source=1)
    gltf.add("images", {"bufferView": gltf.view(png(np.full((4, 4, 3), 77)))})
    assert (texels_of(saved(gltf, tmp_path)) == 77).all()


def test_opacity_cuts_as_that_of_other_images_does(tmp_path: Path) -> None:
    texels = np.full((2, 2, 4), 255, np.uint8)
    texels[0, 0, 3] = 0
    areas = []
    for image in (ktx2(8, 8, uastc(texels), channels=(3,)), png(texels.repeat(4, 0).repeat(4, 1))):
        gltf = with_image(image)
        gltf.document["materials"][0]["alphaMode"] = "MASK"
        with variant(SCALAR) as (mi, _):
            (shape,) = load_scene_source(saved(gltf, tmp_path).source(), mi).shapes()
            areas.append(shape.surface_area())
    assert areas[0] == areas[1] < 4


@pytest.mark.parametrize(
    ("use", "factor", "transfer", "told"),
    [
        ("baseColorTexture", "", 2, ""),
        ("baseColorTexture", "", 0, ""),
        ("baseColorTexture", "", 1, "colours that a KTX2 file calls linear (they are taken as sRGB, as glTF says)"),
        (
            "emissiveTexture",
            "emissiveFactor",
            1,
            "colours that a KTX2 file calls linear (they are taken as sRGB, as glTF says)",
        ),
        ("metallicRoughnessTexture", "metallicFactor", 1, ""),
        (
            "metallicRoughnessTexture",
            "metallicFactor",
            2,
            "numbers that a KTX2 file calls sRGB (they are taken as they are, as glTF says)",
        ),
        ("normalTexture", "", 2, "numbers that a KTX2 file calls sRGB (they are taken as they are, as glTF says)"),
    ],
)
def test_another_encoding_than_that_of_the_use_is_told(
    tmp_path: Path, use: str, factor: str, transfer: int, told: str
) -> None:
    opaque = COLOURS.copy()
    opaque[..., 3] = 255
    scene = saved(with_image(ktx2(8, 8, uastc(opaque), transfer=transfer), use, factor), tmp_path)
    assert [look.what for look in scene.lost_looks if "KTX2" in look.what] == [told] * bool(told)


def test_memory_is_charged_before_it_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gltf = with_image(ktx2(16000, 16000, b"few bytes", scheme=2, unpacked=4000 * 4000 * 16))
    monkeypatch.setenv(VARIABLE, "bytes=1GiB")
    with pytest.raises(
        DecodeError, match=r"images\[0\]: a texture of 16000 x 16000 texels, while it is decoded, needs"
    ):
        saved(gltf, tmp_path)


def test_an_image_that_breaks_a_rule_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        DecodeError, match=r"scene\.glb, images\[0\]: texels in BC .* are not read: export the image as"
    ):
        saved(with_image(ktx2(8, 8, b"", vulkan=146)), tmp_path)
    file = tmp_path / "alone.ktx2"
    file.write_bytes(ktx2(8, 8, b""))
    gltf = with_image(b"")
    gltf.document["images"] = [{"uri": "alone.ktx2"}]
    with pytest.raises(DecodeError, match=r"alone\.ktx2: the finest level must have 64 bytes, got 0"):
        saved(gltf, tmp_path)
