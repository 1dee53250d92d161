"""Tells what the alpha of a colour's texture means in files that do not say it, such as OBJ and PLY.

Most images with alpha are cut out by it: leaves, hair, signs. What it hides is plain there, such as black, or the
smeared colour of an edge. Games keep other things in that channel, such as gloss, and draw the whole surface.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..texture_file import EncodedTexture

_HALF = 128
_MOST_SIDE = 1024
"""Of larger images, some rows and columns are left out."""
_PLAIN = 0.5
"""What changes by less than this mean step of 255 from texel to texel is plain, whatever the rest does."""


def is_drawn_below(texture: EncodedTexture) -> bool:
    """Return whether what the alpha of a texture hides is drawn in as much detail as what it shows, so that it is no
    mask."""
    if texture.alpha is None:
        return False
    step = -(-max(texture.alpha.shape) // _MOST_SIDE)
    grey = texture.texels[::step, ::step].mean(2, dtype=np.float32)
    hidden = texture.alpha[::step, ::step] < _HALF
    below, shown = _detail(grey, hidden), _detail(grey, ~hidden)
    return below > _PLAIN and below >= shown > 0


def _detail(grey: npt.NDArray[np.float32], there: npt.NDArray[np.bool_]) -> float:
    """Return the mean step of grey (H, W) between neighbours that are both there; 0 where there are none."""
    across = np.abs(np.diff(grey, axis=1))[there[:, 1:] & there[:, :-1]]
    along = np.abs(np.diff(grey, axis=0))[there[1:] & there[:-1]]
    count = across.size + along.size
    return float(across.sum() + along.sum()) / count if count else 0.0
