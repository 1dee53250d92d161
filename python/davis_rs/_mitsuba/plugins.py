"""Says which plug-ins this Mitsuba has."""

from __future__ import annotations

import re

from .types import Mitsuba, MitsubaObject


def is_usable(plugin: str, kind: MitsubaObject, mi: Mitsuba) -> bool:
    """Return whether Mitsuba has a plug-in of a kind that this variant can use.

    Args:
        kind: one of ``mi.ObjectType``.
        mi: the module, under the variant in force.
    """
    found = mi.PluginManager.instance().plugin_type(plugin)
    if found == mi.ObjectType.BSDF:
        return bool(kind == found)  # not tried out: a blend without materials ends the process
    if found not in (kind, mi.ObjectType.Unknown):  # those in Python are unknown to it
        return False
    try:
        mi.load_dict({"type": plugin})
    except RuntimeError as error:
        return not re.search(r"\[PluginManager\]|polarized mode", str(error))
    return True
