"""A simulator of the DAVIS event camera: 3D scene and camera path in, events, frames, depth and ground truth out.

``__init__.pyi`` lists what it exports. Each name is imported when it is asked for.
"""

from typing import Any

import lazy_loader

_attached, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name not in __all__:
        from ._util.close_names import did_you_mean

        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{did_you_mean(name, __all__)}", name=name)
    return _attached(name)
