"""Finds what HDF5's names stand for within one file: links to other files are not followed."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from ..._core import DecodeError

if TYPE_CHECKING:
    import h5py

_MOST_LINKS = 16
"""Soft links that lead to each other. Source: HDF5's own limit, ``H5L_NUM_LINKS``."""


def find_inside(path: str | os.PathLike[str], group: h5py.Group, name: str, links: int = 0) -> Any:
    """Return the dataset or group of a name, None where there is none.

    HDF5 would open any file that a link names, of which some never answer, such as a pipe.

    Args:
        links: how many soft links led here.

    Raises:
        DecodeError: for a name that leads into another file, or in circles.
    """
    import h5py

    here: Any = group
    for link_name in filter(None, name.split("/")):
        link = here.get(link_name, getlink=True) if isinstance(here, h5py.Group) else None
        if isinstance(link, h5py.HardLink):
            here = here[link_name]
        elif isinstance(link, h5py.SoftLink):
            if links == _MOST_LINKS:
                raise DecodeError(f"{os.fspath(path)}: {name} leads in circles")
            begin = here.file if link.path.startswith("/") else here
            here = find_inside(path, begin, link.path, links + 1)
        elif link is not None:
            raise DecodeError(f"{os.fspath(path)}: {name} lies in another file: it must be in this one")
        if link is None or here is None:
            return None
    return here
