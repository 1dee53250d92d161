"""Imports Mitsuba and Dr.Jit on first use, and sets a variant for the time of a call."""

from __future__ import annotations

import functools
import os
import re
import sys
import threading
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from .._util.stop_requests import interrupts_deferred
from .files import XmlFile, check_scene_dictionary
from .foreign_plugins import LoadedFile, load_file
from .llvm import HOW_TO_GET_IT, OLDEST_USABLE, find_libllvm, why_none
from .scene_contents import scene_contents
from .types import DrJit, Mitsuba, MitsubaScene, SceneDictionary

FAST, SCALAR = "llvm_ad_rgb", "scalar_rgb"

_FIRST_USE = threading.RLock()
"""Held while Mitsuba is imported and tried out, because a second thread would find a module half initialised."""


def _modules() -> tuple[Mitsuba, DrJit]:
    """Import (mitsuba, drjit) in one thread while the others wait."""
    with _FIRST_USE:
        with nullcontext() if "mitsuba" in sys.modules else interrupts_deferred():
            import drjit as dr
            import mitsuba as mi

        return mi, dr


def default_variant() -> tuple[str, str]:
    """Return (variant, why): ``llvm_ad_rgb`` and the LLVM it uses, or ``scalar_rgb`` and how to get an LLVM."""
    with _FIRST_USE:
        return _usable_variant()


@functools.cache
def _usable_variant() -> tuple[str, str]:
    library = find_libllvm()
    if library is None:
        return SCALAR, f"{why_none()}, so Mitsuba has only its slow scalar variant; {HOW_TO_GET_IT}"
    os.environ["DRJIT_LIBLLVM_PATH"] = str(library.path)
    mi, dr = _modules()
    if FAST not in mi.variants():
        return SCALAR, f"this Mitsuba was built without {FAST}, so it has only its slow scalar variant; {HOW_TO_GET_IT}"
    try:
        with variant(FAST):
            version = dr.detail.llvm_version()
    except ImportError as error:  # the library could not be loaded after all
        return (
            SCALAR,
            f"{library.path} could not be used ({error}), so Mitsuba has only its slow scalar variant; {HOW_TO_GET_IT}",
        )
    # A program that imported Dr.Jit before us may have loaded another library.
    if version < (OLDEST_USABLE,):
        loaded = ".".join(map(str, version))
        return (
            SCALAR,
            f"LLVM {loaded} is loaded already and would abort, so Mitsuba has only its scalar variant; {HOW_TO_GET_IT}",
        )
    return FAST, f"LLVM {'.'.join(map(str, version))}, {library.path} ({library.origin})"


@contextmanager
def variant(name: str) -> Iterator[tuple[Mitsuba, DrJit]]:
    """Set a variant in ``with variant(name) as (mi, dr):``, and restore the caller's own afterwards."""
    mi, dr = _modules()
    before = mi.variant()
    if before != name:
        _set_variant(mi, name)
    try:
        yield mi, dr
    finally:
        if before not in (None, name):
            _set_variant(mi, before)


def variant_is_free() -> bool:
    """Return whether nobody has set a variant yet, we included."""
    return _modules()[0].variant() is None


def stay_in(name: str) -> None:
    """Set a variant for good where none was set, so that a renderer need not change it for each frame."""
    _set_variant(_modules()[0], name)


def _set_variant(mi: Mitsuba, name: str) -> None:
    """Set Mitsuba's variant.

    Setting a variant with derivatives takes Mitsuba 0.2 s, because it reloads its Python integrators. This function
    avoids that where the integrators are already those of the variant: Mitsuba takes their package for new if it has no
    ``common``, and then only imports the modules, which are there. ``common`` is put back afterwards.

    Dr.Jit counts how often functions are decorated, and after 140 changes of variant it would warn the caller.
    """
    integrators: Any = sys.modules.get("mitsuba.python.ad.integrators")
    common = getattr(integrators, "common", None)
    base = getattr(sys.modules.get(f"mitsuba.{name}"), "CppADIntegrator", None)
    if base is not None and base in getattr(getattr(common, "ADIntegrator", None), "__mro__", ()):
        del integrators.common
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "The AST-transforming decorator @drjit.syntax", RuntimeWarning)
            with interrupts_deferred():  # it loads an extension, and modules that belong together
                mi.set_variant(name)
    finally:
        if common is not None:
            vars(integrators).setdefault("common", common)


def load_scene_source(source: Path | XmlFile | Mapping[str, object], mi: Mitsuba) -> MitsubaScene:
    """Load a Mitsuba XML file or scene dictionary.

    In a dictionary, NumPy arrays stand for what Mitsuba wants there: ``to_world`` and ``to_uv`` for transforms, any
    other key for a tensor (a bitmap's ``data``). Equal objects are not merged, so that each keeps its name.

    Raises:
        OSError: if the XML file cannot be read.
        DecodeError: if it, or a PLY mesh of the scene, is malformed in a way that would end the process.
        ValueError: if Mitsuba refuses the scene, or it has no shapes.
    """
    if isinstance(source, Path | XmlFile):
        return load_scene_file(source, mi).scene
    check_scene_dictionary(source)
    with _refusals("the scene dictionary"):
        scene = mi.load_dict(_with_mitsuba_types(source, mi), optimize=False)
    return _with_shapes(scene, "the scene dictionary", mi)


def load_scene_contents(source: Path | XmlFile | Mapping[str, object], mi: Mitsuba) -> MitsubaScene:
    """Load a scene in which Mitsuba traces no rays: :class:`SceneContents` where all its shapes are meshes that are
    made already, and else what :func:`load_scene_source` loads.

    Raises:
        as :func:`load_scene_source`.
    """
    if isinstance(source, Mapping):
        check_scene_dictionary(source)
        with _refusals("the scene dictionary"):
            contents = scene_contents(_with_mitsuba_types(source, mi), mi)
        if contents is not None:
            return contents
    return load_scene_source(source, mi)


def load_scene_file(source: Path | XmlFile, mi: Mitsuba) -> LoadedFile:
    """Load a Mitsuba XML file, with what moves in it, and what is taken otherwise than it says.

    Raises:
        OSError, DecodeError, ValueError: as for :func:`load_scene_source`.
    """
    file = XmlFile(source, {}) if isinstance(source, Path) else source
    with _refusals(str(file.path)):
        loaded = load_file(file, mi)
    _with_shapes(loaded.scene, str(file.path), mi)
    return loaded


@contextmanager
def _refusals(name: str) -> Iterator[None]:
    """Raise ``ValueError`` with a remedy where Mitsuba refuses a scene.

    Args:
        name: of the scene, for the message.
    """
    try:
        yield
    except RuntimeError as error:
        hint = "; an area light needs a shape with an area" if "no probability mass" in str(error) else ""
        if variable := re.search(r"undefined parameter: \$(\w+)", str(error)):
            hint = f"; -D {variable[1]}=VALUE (load_scene(..., variables={{{variable[1]!r}: ...}})) gives it a value"
        if re.search(r"instantiate bsdf plugin .*\[PluginManager\]", str(error)):
            hint = "; --grey-unknown (load_scene(..., grey_unknown=True)) takes materials that are not known as grey"
        raise ValueError(f"Mitsuba cannot load {name}: {error}{hint}") from None


def _with_shapes(scene: MitsubaScene, name: str, mi: Mitsuba) -> MitsubaScene:
    """Return a scene; refuse what is none, or has nothing to see."""
    if not isinstance(scene, mi.Scene):
        raise ValueError(f"{name} must describe a scene, got a {type(scene).__name__}")
    if not scene.shapes():
        raise ValueError(f"{name} has no shapes: there is nothing that a camera could see")
    return scene


def _with_mitsuba_types(node: Mapping[str, object], mi: Mitsuba) -> SceneDictionary:
    def convert(key: str, value: object) -> object:
        if isinstance(value, Mapping):
            return _with_mitsuba_types(value, mi)
        if isinstance(value, np.ndarray):
            return {"to_world": mi.ScalarTransform4f, "to_uv": mi.ScalarTransform3f}.get(key, mi.TensorXf)(value)
        return value

    return {key: convert(key, value) for key, value in node.items()}


def versions(variant_name: str) -> dict[str, str]:
    """Return the versions of Mitsuba, Dr.Jit and LLVM, for a record of the run."""
    mi, dr = _modules()
    names = {"mitsuba": mi.__version__, "drjit": dr.__version__, "variant": variant_name}
    if variant_name == FAST:
        names["llvm"] = ".".join(map(str, dr.detail.llvm_version()))
    return names
