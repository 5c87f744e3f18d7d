"""PageServer: the viewer's page over HTTP, read-only: four files from memory, one picture, one stream of events.

What a visitor sends is a path, and a path is looked up in a table: no file is named by it, nothing is written for it. Only
GET and HEAD are answered. A server bound to this machine answers only to this machine's names, so that no page of
another site can read it by a name of its own (DNS rebinding); scripts, styles and connections are limited to itself.
"""

from __future__ import annotations

import contextlib
import ipaddress
import socket
import socketserver
import threading
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from types import TracebackType
from typing import Any, ClassVar, Self

from curvescan._version import __version__
from curvescan.errors import OutputError
from curvescan.live.viewer import Viewer, encoded

MAX_CONNECTIONS = 64
"""Connections served at once; further ones are closed."""

TIMEOUT = 10.0
"""A visitor who sends, or takes in, nothing for so long is cut off, seconds."""

_FILES: Mapping[str, tuple[str, str]] = {
    "/": ("page.html", "text/html; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
    "/icon.svg": ("icon.svg", "image/svg+xml"),
}
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class PageServer:
    """Serves a viewer's page; a context.

    Raises OutputError.
    """

    def __init__(self, viewer: Viewer, *, host: str = "127.0.0.1", port: int = 0) -> None:
        try:
            self._server = _Server(viewer, host, port)
        except (OSError, OverflowError) as error:
            raise OutputError(
                f"cannot serve the page at {host}:{port}: {error}; choose another --http-port or --host"
            ) from error
        self._viewer = viewer
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)

    @property
    def address(self) -> tuple[str, int]:
        """Address and port it is bound to."""
        host, port = self._server.server_address[:2]
        return str(host), int(port)

    @property
    def url(self) -> str:
        """Where the page is, for a browser on this machine."""
        host, port = self.address
        shown = "127.0.0.1" if host == "0.0.0.0" else "[::1]" if host == "::" else host
        return f"http://{f'[{shown}]' if ':' in shown and '[' not in shown else shown}:{port}/"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._viewer.stop()
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    request_queue_size = 64

    def __init__(self, viewer: Viewer, host: str, port: int) -> None:
        self.viewer = viewer
        self.contents = {
            path: (files("curvescan.live").joinpath("page", name).read_bytes(), kind)
            for path, (name, kind) in _FILES.items()
        }
        if ":" in host:
            self.address_family = socket.AF_INET6
        self._free = threading.BoundedSemaphore(MAX_CONNECTIONS)
        super().__init__((host, port), _Handler)
        self.is_local = _is_loopback(str(self.server_address[0]))

    def server_bind(self) -> None:
        """Bind without asking a name server for our name, which may take seconds."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = (str(self.server_address[0]), int(self.server_address[1]))

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread of its own, if there is room."""
        if not self._free.acquire(blocking=False):
            self.shutdown_request(request)
            return
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection, in its thread."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: a visitor who goes away, or sends nonsense, is no fault of ours."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = TIMEOUT
    protocol_version = "HTTP/1.1"
    server_version, sys_version = f"curvescan/{__version__}", ""
    error_content_type = "text/plain; charset=utf-8"
    error_message_format = "%(code)d %(message)s\n"
    _answers: ClassVar[frozenset[str]] = frozenset({"GET", "HEAD"})

    def parse_request(self) -> bool:
        """Refuse what is no GET or HEAD, and a visitor who calls us by another site's name."""
        if not super().parse_request():
            return False
        self.close_connection = True  # one request a connection: nothing of a body is ever read
        if self.command not in self._answers:
            self.send_error(HTTPStatus.METHOD_NOT_ALLOWED, "only GET and HEAD are answered")
            return False
        hosts = self.headers.get_all("Host") or []
        if len(hosts) > 1 or (self.server.is_local and not _is_ours(hosts)):
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST, "this server does not go by that name")
            return False
        return True

    def do_HEAD(self) -> None:
        """Answer with the headers alone."""
        self.do_GET()

    def do_GET(self) -> None:
        """Answer what stands in the table."""
        path = self.path.partition("?")[0]
        if path in self.server.contents:
            self._send(*self.server.contents[path])
        elif path == "/map.png" and (picture := self.server.viewer.picture) is not None:
            self._send(picture.png, "image/png")
        elif path == "/events":
            self._stream()
        else:
            self.send_error(HTTPStatus.NOT_FOUND, "there is no such page")

    def end_headers(self) -> None:
        """Add what every answer carries."""
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the library's name
        """Keep the terminal for the run."""

    def _send(self, content: bytes, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def _stream(self) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream; charset=utf-8")
        self.send_header("Connection", "close")
        self.end_headers()
        if self.command == "HEAD":
            return
        with contextlib.suppress(OSError):  # the browser has gone, or takes nothing in
            self.wfile.write(b"retry: 1000\n\n")
            for event in self.server.viewer.events():
                self.wfile.write(encoded(event))


def _is_loopback(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False


def _is_ours(hosts: list[str]) -> bool:
    """Return whether the Host that a visitor gave is a name of this machine for itself."""
    if len(hosts) != 1:
        return False
    name = hosts[0].strip().lower()
    bare = name[1 : name.find("]")] if name.startswith("[") else name.partition(":")[0]
    return bare == "localhost" or _is_loopback(bare)
