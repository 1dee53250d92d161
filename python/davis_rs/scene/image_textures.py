"""Makes Mitsuba's textures of images: one of each, however many shapes show it, or stand-ins that hold no texels.

A large image is the largest part of many worlds. Mitsuba's integrators need its texels, once. The renderers without
noise read texels themselves, so that a second copy in Mitsuba would only take memory and time. They load a scene within
:func:`stand_ins`: there each texture is grey, and a table says which image it stands for.

What must not break: nothing is rendered of a scene that was loaded with stand-ins but what looks images up in the
table.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

import numpy as np

from .._mitsuba.types import MitsubaTexture
from .._util.budget import Budget
from .texture_file import EncodedTexture
from .textures import bitmap, encoded_bitmap


class ImageTexture(NamedTuple):
    """Says how an image is looked up.

    Attributes:
        image: its texels.
        wrap: what lies beyond its edges: repeat, clamp or mirror.
        nearest: texels have hard edges; others are bilinear.
    """

    image: EncodedTexture
    wrap: str
    nearest: bool

    @property
    def key(self) -> tuple[int, bytes, str, bool]:
        """What two textures have in common that are one; as long as the image is kept, its texels keep their number."""
        return id(self.image.texels), self.image.tint.tobytes(), self.wrap, self.nearest


StandIns = dict[MitsubaTexture, ImageTexture]
"""What stands for which image; by Mitsuba's own objects."""

_stand_ins: ContextVar[StandIns | None] = ContextVar("stand_ins", default=None)


@contextmanager
def stand_ins() -> Iterator[StandIns]:
    """Let scenes that are loaded within have stand-ins in place of their images, and give what each stands for."""
    made: StandIns = {}
    token = _stand_ins.set(made)
    try:
        yield made
    finally:
        _stand_ins.reset(token)


class ImageTextures:
    """Makes the textures of one scene; each is one object, for all shapes that look up the same image alike."""

    def __init__(self) -> None:
        self._made: dict[tuple[int, bytes, str, bool], tuple[ImageTexture, MitsubaTexture]] = {}

    def of(self, texture: ImageTexture) -> MitsubaTexture:
        """Return Mitsuba's texture, or its stand-in; call it under the variant that loads the scene."""
        if texture.key not in self._made:
            self._made[texture.key] = texture, _stand_in(texture) or _with_texels(texture)
        return self._made[texture.key][1]


class ChargedImages:
    """Charges a budget for the textures that :class:`ImageTextures` makes of one scene: each once.

    Args:
        budget: what the scene's file may take.
    """

    def __init__(self, budget: Budget) -> None:
        self._budget = budget
        self._charged: dict[tuple[int, bytes, str, bool], ImageTexture] = {}

    def charge(self, texture: ImageTexture, where: str) -> None:
        """Charge for one more use of a texture.

        Raises:
            DecodeError: if the budget has not enough left.
        """
        if texture.key not in self._charged:
            texture.image.charge(self._budget, where)
            self._charged[texture.key] = texture


def _stand_in(texture: ImageTexture) -> MitsubaTexture | None:
    """Return a texture without texels, and enter what it stands for; None where none are asked for."""
    import mitsuba as mi

    made = _stand_ins.get()
    if made is None:
        return None
    # Of 8 bits, as images are: whoever asks whether a texture is the same everywhere learns that it is an image.
    stand_in = mi.load_dict(encoded_bitmap(mi.Bitmap(np.full((1, 1, 3), 128, np.uint8))))
    made[stand_in] = texture
    return stand_in


def _with_texels(texture: ImageTexture) -> MitsubaTexture:
    """Return a texture of Mitsuba with its texels; untinted ones keep the 8 bits of their file."""
    import mitsuba as mi

    image, wrap, nearest = texture
    if image.is_tinted:  # Mitsuba has no textures of 8 bits times a colour
        return mi.load_dict(bitmap(mi.TensorXf(image.linear()), wrap=wrap, nearest=nearest))
    encoded = mi.Bitmap(image.texels, mi.Bitmap.PixelFormat.RGB)
    encoded.set_srgb_gamma(True)
    return mi.load_dict(encoded_bitmap(encoded, wrap=wrap, nearest=nearest))
