"""Reads a folder of images as frames, with the lists of stamps that ESIM, vid2e and dataset folders have."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path, PurePosixPath

from ..._core import DecodeError
from ..._util.argument_error import ArgumentError
from ..._util.untrusted import read_text
from ...io.dataset.files import FRAMES
from .frame_source import Encoding, FrameSource, StampedFrame, Stamps
from .image_file import IMAGE_SUFFIXES, read_frame_image
from .stamps import parse_stamp, rate_stamps, read_stamps, text_lines

_LISTS = {FRAMES.list_name: "s", "images.csv": "ns"}
"""Lists of stamps and file names, with the unit of their stamps: of a dataset folder, and of ESIM's
DataProviderFromFolder."""

_STAMP_FILES = ("timestamps.txt",)
"""Stamps in seconds, one a line, of the images in order: vid2e's upsampling writes it, esim_py reads it."""

_RATE_FILE = "fps.txt"
"""A frame rate, in the folders that vid2e upsamples."""

_SUB_FOLDERS = ("imgs", "images")
"""Where vid2e and dataset folders keep the images."""


class ImageFolder(FrameSource):
    """Reads the images of a folder, in the order of a list of stamps, or of the numbers in their names.

    Args:
        path: the folder.
        stamps_ns: of the images in the order of their names; None takes those of the folder itself: ``images.txt``
            (``timestamp name``, seconds), ``images.csv`` (ESIM: nanoseconds and name), ``timestamps.txt`` (vid2e:
            seconds), or ``fps.txt`` (vid2e: a rate), looked for in this order.

    Raises:
        OSError: if there is no such folder.
        DecodeError: for a malformed list.
        ValueError: for a folder without images, with several kinds of them, without stamps, or with another number of
            stamps than of images.
    """

    def __init__(self, path: str | Path, stamps_ns: Stamps | None = None) -> None:
        self._folder = Path(path)
        self.name = str(path)
        self._stamps_from = "given"
        listed = None if stamps_ns is not None else self._listed()
        if listed is None:
            files = _images(self._folder)
            if stamps_ns is None:
                stamps_ns, self._stamps_from = self._own_stamps()
            endless = isinstance(stamps_ns, Iterator)
            stamps = list(islice(stamps_ns, len(files))) if endless else list(stamps_ns)
            if len(stamps) != len(files):
                raise ValueError(f"{path}: {len(files)} images need as many stamps, got {len(stamps)}")
            listed = list(zip(stamps, files, strict=True))
        self._listed_files = listed
        self.count = len(listed)

    def frames(self) -> Iterator[StampedFrame]:
        for number, (t_ns, file) in enumerate(self._listed_files):
            yield StampedFrame(t_ns, read_frame_image(file), f"{file} (frame {number})")

    def encoding(self, first: StampedFrame) -> Encoding:
        return Encoding.of(first.image.dtype, first.where)

    def describe(self) -> dict[str, object]:
        first = self._listed_files[0][1].name
        return {
            "kind": "images",
            "folder": self.name,
            "first": first,
            "frames": self.count,
            "stamps": self._stamps_from,
        }

    def _listed(self) -> list[tuple[int, Path]] | None:
        """Read stamps and files of a list in the folder, if there is one."""
        for name, unit in _LISTS.items():
            path = self._folder / name
            if not path.is_file():
                continue
            stamped = []
            for number, words in text_lines(read_text(path)):
                if number == 1 and not words[0][:1].isdigit():  # a line of column names
                    continue
                file = PurePosixPath(words[1]) if len(words) == 2 else None
                if file is None or file.is_absolute() or ".." in file.parts or "\0" in words[1]:
                    raise DecodeError(
                        f"{path}, line {number}: expected a stamp and a file of this folder, found {words}"
                    )
                stamped.append((parse_stamp(words[0], path, number, unit), self._folder / file))
            if not stamped:
                raise ValueError(f"{path} lists no images")
            self._stamps_from = name
            return stamped
        return None

    def _own_stamps(self) -> tuple[Stamps, str]:
        for folder in (self._folder, self._folder.parent):  # vid2e's stand next to the folder of the images
            for name in _STAMP_FILES:
                if (folder / name).is_file():
                    return read_stamps(folder / name, "s").tolist(), name
            if (folder / _RATE_FILE).is_file():
                text = read_text(folder / _RATE_FILE).strip()
                try:
                    return rate_stamps(float(text)), _RATE_FILE
                except ValueError:
                    raise DecodeError(f"{folder / _RATE_FILE}: expected a frame rate, found {text[:40]!r}") from None
        raise ArgumentError(
            "{} has no {} that says when its images were taken: give {timestamps} or {fps}",
            self.name,
            ", ".join([*_LISTS, *_STAMP_FILES, _RATE_FILE]),
        )


def _images(folder: Path) -> list[Path]:
    """List the images of the folder, or of the sub-folder that vid2e and datasets keep them in, by the numbers in their
    names."""
    images = _images_in(folder)
    for name in _SUB_FOLDERS:
        if not images and (folder / name).is_dir():
            images = _images_in(folder / name)
    if not images:
        raise ValueError(f"{folder} has no images in it ({', '.join(IMAGE_SUFFIXES)})")
    kinds = sorted({file.suffix.lower() for file in images})
    if len(kinds) > 1 and set(kinds) not in ({".jpg", ".jpeg"}, {".tif", ".tiff"}):
        raise ValueError(f"{folder} has images of several kinds ({', '.join(kinds)}): which are the frames?")
    return images


def _images_in(folder: Path) -> list[Path]:
    files = (file for file in folder.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES and file.name[:1] != ".")
    return sorted(files, key=_by_numbers)


def _by_numbers(file: Path) -> tuple[list[tuple[str, int]], str]:
    """Return a key by which frame_2 comes before frame_10."""
    words = re.findall(r"(\D*)(\d*)", file.stem)
    return [(text, int(number or -1)) for text, number in words], file.name
