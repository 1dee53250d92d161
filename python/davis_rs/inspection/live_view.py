"""Shows events in a browser as they come: one page, served to this machine alone.

A thread serves the page and, on a second request, a stream of pictures. A picture says for each pixel with events since
the picture before which polarity its last event had; the page lets pixels fade. So what is sent is bounded by the
sensor's size and the rate of pictures, whatever the rate of events, and nobody who looks slows a run or a camera down.

What must not break: only 127.0.0.1 is listened to, and only the address with this run's own random word is answered,
so that no other page in the browser can read it.
"""

from __future__ import annotations

import html
import secrets
import struct
import threading
import webbrowser
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from types import TracebackType

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import as_size
from ..events.arrays import EventArray

PICTURE_S = 0.04
"""Time between two pictures, in seconds."""

_STARTS_S = 10.0
"""How long a browser may take to start."""

_HEAD = struct.Struct("<IqQ")
"""Of a picture: pixels that changed, microseconds, events so far. Each pixel is a uint32: twice its number, plus its
polarity. A head of 2^32 - 1 pixels is the end."""

_END = 2**32 - 1


class LiveView:
    """Serves a page on this machine that shows events as they come; a context manager.

    >>> with LiveView((240, 180), "three_planes") as view:
    ...     for packet in davis_rs.simulate(scene):
    ...         view.add(packet.events, packet.end_us)

    Args:
        size: (width, height) of the sensor in pixels.
        title: of the page.
        browser: open the page in the user's browser; else its ``address`` is for the caller to tell.

    Attributes:
        address: of the page.

    Raises:
        ValueError: for a size out of range.
        OSError: if no port can be had.
    """

    def __init__(self, size: tuple[int, int], title: str, *, browser: bool = True) -> None:
        self._size, self._title = as_size(size), title
        self._lock = threading.Condition()
        self._latest = np.zeros(self._size[0] * self._size[1], np.uint8)
        """Of each pixel since the start: 0 for no event, 1 OFF, 2 ON."""
        self._picture_of = np.zeros(len(self._latest), np.int64)
        self._watched = threading.Event()
        self._picture, self._t_us, self._events, self._over = 1, 0, 0, False
        word = secrets.token_urlsafe(16)
        self._server = _Server(("127.0.0.1", 0), _handler(self, word))
        self.address = f"http://127.0.0.1:{self._server.server_port}/{word}/"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(PICTURE_S,), daemon=True)
        self._thread.start()
        self.opened = browser and webbrowser.open(self.address)

    def add(self, events: EventArray, t_us: int) -> None:
        """Show events, which lie on the sensor; the stream has come to ``t_us``."""
        with self._lock:
            if len(events):
                pixel = events["y"].astype(np.int64) * self._size[0] + events["x"]
                self._latest[pixel] = events["p"] + np.uint8(1)  # of several, the last one stays
                self._picture_of[pixel] = self._picture
            self._events += len(events)
            self._t_us = max(self._t_us, t_us)

    def __enter__(self) -> LiveView:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None = None,
        exc_value: BaseException | None = None,
        traceback: TracebackType | None = None,
    ) -> None:
        """End the stream; the page keeps its last picture. A browser that was just opened is waited for."""
        if self.opened and exc_type is None:
            self._watched.wait(_STARTS_S)
        with self._lock:
            self._over = True
            self._lock.notify_all()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def _page(self) -> bytes:
        text = (files(__package__) / "web" / "live.html").read_text("utf-8")
        width, height = self._size
        return (
            text.replace("$TITLE", html.escape(self._title))
            .replace("$WIDTH", str(width))
            .replace("$HEIGHT", str(height))
            .encode()
        )

    def _changed(self, since: int) -> tuple[bytes, int, bool]:
        """Wait for a picture's time; return what changed after picture ``since``, the picture's number, and whether it
        is the last one."""
        with self._lock:
            self._lock.wait_for(lambda: self._over, PICTURE_S)
            picture, over = self._picture, self._over
            self._picture += 1
            pixels: npt.NDArray[np.int64] = np.flatnonzero(self._picture_of > since)
            words = (2 * pixels + self._latest[pixels] - 1).astype("<u4")
            return _HEAD.pack(len(words), self._t_us, self._events) + words.tobytes(), picture, over


class _Server(ThreadingHTTPServer):
    daemon_threads = False  # each is waited for at the end, so that the last picture arrives
    block_on_close = True


def _handler(view: LiveView, word: str) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        timeout = 10.0

        def do_GET(self) -> None:
            if self.path == f"/{word}/":
                self._answer("text/html; charset=utf-8", view._page())
            elif self.path == f"/{word}/pictures":
                self._pictures()
            else:
                self.send_error(HTTPStatus.NOT_FOUND)

        def _answer(self, kind: str, body: bytes) -> None:
            self._begin(kind)
            self.wfile.write(body)

        def _begin(self, kind: str) -> None:
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", kind)
            self.send_header("Cache-Control", "no-store")
            self.send_header(
                "Content-Security-Policy",
                "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'",
            )
            self.end_headers()

        def _pictures(self) -> None:
            self._begin("application/octet-stream")
            view._watched.set()
            since, over = 0, False
            try:
                while not over:
                    data, since, over = view._changed(since)
                    self.wfile.write(data)
                self.wfile.write(_HEAD.pack(_END, 0, 0))
            except OSError:
                return  # the page was closed

        def log_message(self, format: str, *values: object) -> None:
            """Say nothing: the terminal has the run's bar."""

    return Handler
