"""Reads a video file as frames: the container's own stamps, range, matrix and transfer function, by PyAV (FFmpeg)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.budget import limits_in_use
from ..._util.untrusted import regular_file
from .frame_source import PIXEL_BYTES, Encoding, FrameArray, FrameSource, GivenStamps, StampedFrame, Stamps

_FULL, _LIMITED = 2, 1
"""FFmpeg's numbers of colour ranges; 0 is unspecified."""

_MATRICES = {
    1: (0.2126, 0.0722),
    4: (0.30, 0.11),
    5: (0.299, 0.114),
    6: (0.299, 0.114),
    7: (0.212, 0.087),
    9: (0.2627, 0.0593),
}
"""Weights of red and blue in Y' by FFmpeg's number of the matrix (ITU-T H.273, table 4)."""

_UNSPECIFIED_MATRICES = {0, 2, 3}
_HIGH_DEFINITION = (1280, 577)
"""From this width or height on, players take an unspecified matrix for that of BT.709, below for that of BT.601."""

_TRANSFERS = {
    1: "rec709", 2: "srgb", 3: "srgb", 4: "gamma=2.2", 5: "gamma=2.8", 6: "rec709", 8: "linear", 13: "srgb",
    14: "rec709", 15: "rec709",
}  # fmt: skip
"""Our names by FFmpeg's number of the transfer function (ITU-T H.273, table 3); 2 is unspecified."""

_TRANSFER_NAMES = {
    7: "SMPTE 240M",
    9: "log 100:1",
    10: "log 316:1",
    11: "xvYCC",
    12: "BT.1361",
    16: "PQ",
    17: "SMPTE 428",
    18: "HLG",
}


_CONTAINERS = (
    "apng", "asf", "avi", "dv", "flv", "gif", "h264", "hevc", "ivf", "m4v", "matroska", "mjpeg", "mov", "mpeg",
    "mpegts", "mpegvideo", "mxf", "nut", "obu", "ogg", "wtv", "yuv4mpegpipe",
)  # fmt: skip
"""FFmpeg's names of the kinds of files that are read: those that hold their frames themselves. Playlists and lists of
files (HLS, DASH, concat, image2) open whatever they name."""


class Video(FrameSource):
    """Reads the frames of a video file's first video stream, turned upright as its metadata say.

    Colour is decoded without FFmpeg's 8-bit conversion: Y'CbCr in the stream's own bits and range goes through the
    matrix that the stream names to R'G'B' of 16 bits.

    Args:
        path: a regular file.
        stamps_ns: in place of the container's; None takes those, which count from the first frame on.

    Raises:
        ImportError: without PyAV, saying how to get it.
        OSError: if the file cannot be read.
        DecodeError: if it is no video, or one of a codec or a pixel format that cannot be taken.
    """

    def __init__(self, path: str | Path, stamps_ns: Stamps | None = None) -> None:
        self._path, self._stamps = regular_file(path), stamps_ns
        self.name = str(path)
        with self._opened() as (_, stream):
            self._about = _format_of(stream)
            if stream.frames > 0:
                self.count = stream.frames

    def encoding(self, first: StampedFrame) -> Encoding:
        bits = self._about.bits
        limited = self._about.range == "limited"
        black, white = (16 << (bits - 8), 235 << (bits - 8)) if limited else (0, (1 << bits) - 1)
        in_frames = (0.0, float(np.iinfo(first.image.dtype).max))
        return Encoding(self._about.transfer, black, white, white - black, in_frames)

    def describe(self) -> dict[str, object]:
        stamps = "container" if self._stamps is None else "given"
        return {"kind": "video", "file": self.name, **asdict(self._about), "stamps": stamps}

    def frames(self) -> Iterator[StampedFrame]:
        with self._opened() as (container, stream):
            yield from self._decoded(container, stream)

    def _decoded(self, container: Any, stream: Any) -> Iterator[StampedFrame]:
        given = None if self._stamps is None else GivenStamps(self._stamps, self.name)
        converter = _Converter(self._about, self.name)
        first_pts: int | None = None
        number, end = 0, Fraction(0)
        decoded = container.decode(stream)
        while True:
            where = f"{self.name}, frame {number}"
            with _ffmpeg_errors(where):
                frame = next(decoded, None)
            if frame is None:
                break
            if frame.is_corrupt:
                raise DecodeError(f"{where}: the decoder found it corrupt")
            if frame.interlaced_frame:
                raise DecodeError(
                    f"{where}: it is interlaced, so its two halves are of two instants: deinterlace the video first "
                    "(ffmpeg -i IN -vf bwdif OUT)"
                )
            if given is None:
                if frame.pts is None:
                    raise DecodeError(f"{where}: it has no time stamp in the file: give fps or timestamps")
                first_pts = frame.pts if first_pts is None else first_pts
                seconds = (frame.pts - first_pts) * Fraction(frame.time_base)
                t_ns = round(seconds * 1_000_000_000)
                end = max(end, seconds)
            else:
                t_ns = given.next(where)
            with _ffmpeg_errors(where):
                image = converter.image(frame, where)
            yield StampedFrame(t_ns, image, where)
            number += 1
        if given is not None:
            given.end()
        self._require_whole(container, stream, number, end)

    def _require_whole(self, container: Any, stream: Any, number: int, end: Fraction) -> None:
        """Refuse a file that ends before its own header says."""
        if stream.frames > number:
            raise DecodeError(f"{self.name}: cut short: its header says {stream.frames} frames, it has {number}")
        if stream.frames or self._stamps is not None or container.duration is None or number < 2:
            return
        stated = Fraction(container.duration, 1_000_000)
        # The last frame is shown for a while too, and other streams may be a little longer.
        if end + 2 * end / (number - 1) + Fraction(1, 2) < stated and end < stated * Fraction(9, 10):
            raise DecodeError(
                f"{self.name}: cut short: its header says {float(stated):.3f} s, its last frame is at "
                f"{float(end):.3f} s"
            )

    @contextmanager
    def _opened(self) -> Iterator[tuple[Any, Any]]:
        """Open the container and its first video stream."""
        av = _pyav()
        with _ffmpeg_errors(self.name):
            # A file, whatever its name looks like, and nothing that its contents may refer to elsewhere.
            options = {"protocol_whitelist": "file", "format_whitelist": ",".join(_CONTAINERS)}
            try:
                container = av.open(f"file:{self._path}", options=options)
            except av.ArgumentError as error:  # what FFmpeg says of a kind that it must not read
                kinds = "MP4, MOV, Matroska, WebM, AVI, MPEG, and others that hold their frames themselves"
                raise DecodeError(f"{self.name}: it is no video of a kind that is read: {kinds}") from error
            except av.InvalidDataError as error:
                rule = "frames must be a video, a folder of images or a .npy file"
                raise DecodeError(f"{self.name}: it is no video, or a damaged one; {rule}") from error
        with container:
            if not container.streams.video:
                raise DecodeError(f"{self.name}: there is no video stream in it")
            stream = container.streams.video[0]
            if stream.codec_context is None:
                raise DecodeError(f"{self.name}: its codec is not one that FFmpeg knows")
            codec = stream.codec_context
            # The library's own limits and its own report of damage, in place of its guesses at what was there.
            most = limits_in_use().bytes // PIXEL_BYTES
            codec.options = {"max_pixels": str(most), "err_detect": "explode"}
            stream.thread_type = "AUTO"
            yield container, stream


def _pyav() -> Any:
    try:
        import av
    except ImportError as error:
        raise ImportError("reading a video needs PyAV: pip install 'davis_rs[video]'") from error
    av.logging.set_level(None)  # what it would print comes as exceptions
    return av


@contextmanager
def _ffmpeg_errors(where: str) -> Iterator[None]:
    """Wraps calls of FFmpeg. Its errors about bytes become a DecodeError that names the file and the frame."""
    import av

    try:
        yield
    except (DecodeError, FileNotFoundError, PermissionError):
        raise
    except (av.FFmpegError, ValueError, EOFError, LookupError, RuntimeError) as error:
        said = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise DecodeError(f"{where}: {said}") from error


@dataclass(frozen=True)
class _StreamFormat:
    """Holds what a stream says of itself, and what is taken where it says nothing; its fields are those of meta.json.

    Attributes:
        codec, pixel_format: by FFmpeg's names.
        bits: of a value.
        width, height: in pixels.
        range: ``full`` or ``limited``; ``range_stated`` tells whether the stream says so.
        matrix: of YUV, by FFmpeg's number; None for other formats. ``matrix_stated`` likewise.
        transfer: by our name, or by FFmpeg's where we have none; ``transfer_stated`` likewise.
    """

    codec: str
    pixel_format: str
    bits: int
    width: int
    height: int
    range: str
    range_stated: bool
    matrix: int | None
    matrix_stated: bool
    transfer: str
    transfer_stated: bool


def _format_of(stream: Any) -> _StreamFormat:
    """Read the format of PyAV's stream."""
    codec = stream.codec_context
    if codec.format is None:
        raise DecodeError(f"{stream.container.name}: it does not say its pixel format: cut short, or no video")
    name = codec.format.name
    bits = max(component.bits for component in codec.format.components)
    grey = name.startswith("gray")
    yuv = not grey and not codec.format.is_rgb and not name.startswith("pal")
    range_number = int(codec.color_range)
    full = range_number == _FULL or (range_number == 0 and (not yuv or name.startswith("yuvj")))
    matrix = int(codec.colorspace)
    if matrix in _UNSPECIFIED_MATRICES:
        matrix = 1 if codec.width >= _HIGH_DEFINITION[0] or codec.height >= _HIGH_DEFINITION[1] else 5
    transfer = int(codec.color_trc)
    return _StreamFormat(
        codec=codec.name,
        pixel_format=name,
        bits=8 if name.startswith("pal") else bits,
        width=codec.width,
        height=codec.height,
        range="full" if full else "limited",
        range_stated=range_number != 0,
        matrix=matrix if yuv else None,
        matrix_stated=int(codec.colorspace) not in _UNSPECIFIED_MATRICES,
        transfer=_TRANSFERS.get(transfer, f"FFmpeg's {transfer} ({_TRANSFER_NAMES.get(transfer, 'unknown')})"),
        transfer_stated=transfer != 2,
    )


class _Converter:
    """Turns FFmpeg's frames into arrays: all of one size and pixel format, those of the stream."""

    def __init__(self, about: _StreamFormat, name: str) -> None:
        self._about, self._name = about, name

    def image(self, frame: Any, where: str) -> FrameArray:
        """Return the image as uint8 or uint16, (H, W) or (H, W, 3)."""
        about = self._about
        if (frame.width, frame.height) != (about.width, about.height):
            raise DecodeError(
                f"{where}: it has {frame.width} x {frame.height} pixels, those before {about.width} x {about.height}"
            )
        pixel_format = frame.format.name
        if pixel_format != about.pixel_format:
            raise DecodeError(f"{where}: its pixel format is {pixel_format}, of those before {about.pixel_format}")
        image = self._decoded(frame, pixel_format, where)
        if frame.rotation % 90:
            raise DecodeError(f"{where}: it is to be turned by {frame.rotation} degrees, which is no multiple of 90")
        return np.ascontiguousarray(np.rot90(image, frame.rotation // 90)) if frame.rotation else image

    def _decoded(self, frame: Any, pixel_format: str, where: str) -> FrameArray:
        bits, full = self._about.bits, self._about.range == "full"
        if pixel_format.startswith(("bayer", "xyz")) or bits > 16 or "f16" in pixel_format:
            raise DecodeError(
                f"{where}: pixel format {pixel_format} cannot be taken; FFmpeg can convert the video "
                "(ffmpeg -i IN -pix_fmt yuv444p16 -c:v ffv1 OUT.mkv)"
            )
        if frame.format.is_rgb or pixel_format.startswith("pal"):
            return _of_rgb(frame, pixel_format, bits, where)
        if any(component.is_alpha for component in frame.format.components):
            raise DecodeError(
                f"{where}: pixels must be opaque, and its pixel format {pixel_format} has an alpha channel"
            )
        scale = 1 << (bits - 8)
        black, span = (0.0, float((1 << bits) - 1)) if full else (16.0 * scale, 219.0 * scale)
        if pixel_format.startswith("gray"):
            return _to_16_bits((_plane(frame, 0, bits) - np.float32(black)) / np.float32(span))
        return self._of_yuv(frame, bits, black, span, full)

    def _of_yuv(self, frame: Any, bits: int, black: float, span: float, full: bool) -> npt.NDArray[np.uint16]:
        """Compute R'G'B' from Y'CbCr: chroma brought to all pixels by FFmpeg, the matrix in float32."""
        target = "yuv444p" if bits == 8 else f"yuv444p{bits}le"
        if frame.format.name not in (target, target.replace("yuv", "yuvj")):
            number = _FULL if full else _LIMITED
            frame = frame.reformat(format=target, src_color_range=number, dst_color_range=number)
        red, blue = _MATRICES.get(self._about.matrix or 5, _MATRICES[5])
        green = 1 - red - blue
        middle = np.float32(1 << (bits - 1))
        chroma_span = np.float32(span if full else 224.0 * (1 << (bits - 8)))
        luma = (_plane(frame, 0, bits) - np.float32(black)) / np.float32(span)
        cb, cr = ((_plane(frame, k, bits) - middle) / chroma_span for k in (1, 2))
        by_cr, by_cb = 2 * (1 - red), 2 * (1 - blue)
        image = np.empty((*luma.shape, 3), np.float32)
        image[..., 0] = luma + np.float32(by_cr) * cr
        image[..., 1] = luma - np.float32(red * by_cr / green) * cr - np.float32(blue * by_cb / green) * cb
        image[..., 2] = luma + np.float32(by_cb) * cb
        return _to_16_bits(image)


def _to_16_bits(image: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
    """Return 0..1 as 0..65535; values of limited range below black and above white are clipped."""
    return np.rint(np.clip(image, 0, 1) * np.float32(65535)).astype(np.uint16)


def _plane(frame: Any, number: int, bits: int) -> npt.NDArray[np.float32]:
    """Return a plane of a planar frame (h, w), without the padding of its lines."""
    plane = frame.planes[number]
    dtype = np.dtype(np.uint8 if bits == 8 else np.dtype("<u2"))
    lines = np.frombuffer(plane, dtype).reshape(-1, plane.line_size // dtype.itemsize)
    return np.asarray(lines[: plane.height, : plane.width], np.float32)


def _of_rgb(frame: Any, pixel_format: str, bits: int, where: str) -> FrameArray:
    if bits > 8:
        image = np.asarray(frame.to_ndarray(format="rgb48le"))
        return image
    if any(component.is_alpha for component in frame.format.components) or pixel_format.startswith("pal"):
        whole = np.asarray(frame.to_ndarray(format="rgba"))
        if (whole[..., 3] != 255).any():
            raise DecodeError(f"{where}: pixels must be opaque, found an alpha channel that is not")
        return np.ascontiguousarray(whole[..., :3])
    return np.asarray(frame.to_ndarray(format="rgb24"))
