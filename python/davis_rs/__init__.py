"""A simulator of the DAVIS event camera: 3D scene and camera path in, events, frames, depth and ground truth out.

``__init__.pyi`` lists what it exports. Each name is imported when it is asked for. Nothing is imported before that,
because the command line's first line, which sees to Ctrl-C, comes after this.
"""

from __future__ import annotations

TYPE_CHECKING = False  # as typing's, which is not imported here
if TYPE_CHECKING:
    from collections.abc import Callable


_exports: tuple[Callable[[str], object], list[str]] | None = None


def _listed() -> tuple[Callable[[str], object], list[str]]:
    """Read the list of exports once: what imports one of them, and their names."""
    global _exports
    if _exports is None:
        import lazy_loader

        attached, _, names = lazy_loader.attach_stub(__name__, __file__)
        _exports = attached, names
    return _exports


def __getattr__(name: str) -> object:
    from ._util.stop_requests import interrupts_deferred

    with interrupts_deferred():
        attached, names = _listed()
        if name == "__all__":
            return names
        if name in names:
            return attached(name)
    from ._util.close_names import did_you_mean

    raise AttributeError(f"module {__name__!r} has no attribute {name!r}{did_you_mean(name, names)}", name=name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_listed()[1]})
