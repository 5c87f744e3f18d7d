"""PageServer: a page over HTTP: files from memory, what its site has to show, one stream of events, and actions.

What a visitor sends is a path, and a path is looked up in a table: no file is named by it, nothing is written for it. A
server bound to this machine answers only to this machine's names, so that no page of another site can read it by a name
of its own (DNS rebinding); scripts, styles and connections are limited to itself. An action is a POST that carries the
token of this server, which only its own page can read; where other machines may look on, there are no actions.
"""

import contextlib
import hmac
import ipaddress
import json
import secrets
import socket
import socketserver
import threading
from collections.abc import Iterator, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, Protocol, Self

from curvescan._version import __version__
from curvescan.errors import CurvescanError, InvalidArgumentError, OutputError

MAX_CONNECTIONS = 64  # connections served at once; further ones are closed
TIMEOUT = 10.0  # a visitor who sends, or takes in, nothing for so long is cut off, seconds
MAX_BODY = 1 << 16  # longest text of an action, bytes

_ACTION, _TOKEN, JSON = "/do/", "X-Curvescan-Token", "application/json"
_KINDS = {
    **{f".{kind}": f"text/{kind}; charset=utf-8" for kind in ("html", "css")},
    **{".js": "text/javascript; charset=utf-8", ".svg": "image/svg+xml"},
}
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


Content = tuple[bytes, str]  # what is sent, and its media type

Event = tuple[str, dict[str, Any]]


class Site(Protocol):
    """What a page shows."""

    page: str  # name of its HTML and, with .js, of its script
    actions: frozenset[str]  # names of what the page may ask for

    def content(self, path: str) -> Content | None:
        """Return what there is under a path; None where there is nothing."""

    def events(self) -> Iterator[Event | None] | None:
        """Return what a new browser is told, from the beginning, None as a sign of life; None without a stream."""

    def act(self, name: str, arguments: Mapping[str, Any]) -> Content:
        """Carry out one request of the page. Raises CurvescanError."""

    def stop(self) -> None:
        """End the streams of all browsers."""


class PageServer:
    """Serves the page of a site; a context."""

    def __init__(self, site: Site, *, host: str = "127.0.0.1", port: int = 0) -> None:
        try:
            self._server = _Server(site, host, port)
        except (OSError, OverflowError) as error:
            raise OutputError(
                f"cannot serve the page at {host}:{port}: {error}; choose another --http-port or --host"
            ) from error
        self._site = site
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)

    @property
    def address(self) -> tuple[str, int]:
        """Address and port it is bound to."""
        host, port = self._server.server_address[:2]
        return str(host), int(port)

    @property
    def url(self) -> str:
        """Where the page is, for a browser on this machine."""
        return local_url("http", *self.address) + "/"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._site.stop()
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    request_queue_size = 64

    def __init__(self, site: Site, host: str, port: int) -> None:
        self.site = site
        folder = files("curvescan.live").joinpath("page")
        paths = {f"/{name}": name for name in ("stage.js", f"{site.page}.js", "page.css", "icon.svg")}
        paths["/"] = f"{site.page}.html"
        self.contents: dict[str, Content] = {
            path: (folder.joinpath(name).read_bytes(), _KINDS[name[name.rindex(".") :]]) for path, name in paths.items()
        }
        if ":" in host:
            self.address_family = socket.AF_INET6
        self._free = threading.BoundedSemaphore(MAX_CONNECTIONS)
        super().__init__((host, port), _Handler)
        self.is_local = _is_loopback(str(self.server_address[0]))
        self.token = secrets.token_urlsafe(24)
        if self.is_local and site.actions:
            self.contents["/token"] = (self.token.encode(), "text/plain")

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

    def parse_request(self) -> bool:
        """Refuse what is no GET, HEAD or action, and a visitor who calls us by another site's name."""
        if not super().parse_request():
            return False
        self.close_connection = True  # one request a connection: only an action has a body
        is_action = self.command == "POST" and self._action() in self.server.site.actions and self.server.is_local
        if self.command not in ("GET", "HEAD") and not is_action:
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
        if path == "/events" and (events := self.server.site.events()) is not None:
            self._stream(events)
        elif (content := self.server.contents.get(path) or self.server.site.content(path)) is not None:
            self._send(*content)
        else:
            self.send_error(HTTPStatus.NOT_FOUND, "there is no such page")

    def do_POST(self) -> None:
        """Do what our own page asks for, and nobody else."""
        origin, length = self.headers.get("Origin"), self.headers.get("Content-Length", "")
        given = self.headers.get(_TOKEN, "").encode()
        is_ours = origin in (None, f"http://{self.headers['Host']}") and self.headers.get("Content-Type") == JSON
        if not is_ours or not hmac.compare_digest(given, self.server.token.encode()):
            self.send_error(HTTPStatus.FORBIDDEN, "only the page of this server may ask for that")
        elif not (length.isascii() and length.isdigit() and int(length) <= MAX_BODY):
            self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "the request has no length, or is too long")
        else:
            try:
                arguments = json.loads(self.rfile.read(int(length)))
                if not isinstance(arguments, dict):
                    raise InvalidArgumentError("an action takes an object")
                self._send(*self.server.site.act(self._action(), arguments))
            except (CurvescanError, ValueError, TypeError, KeyError, RecursionError) as error:
                text = json.dumps({"error": str(error)}).encode()
                self._send(text, JSON, HTTPStatus.UNPROCESSABLE_ENTITY)

    def _action(self) -> str:
        """Return the name of the action that was asked for; empty where none was."""
        return self.path.removeprefix(_ACTION) if self.path.startswith(_ACTION) else ""

    def end_headers(self) -> None:
        """Add what every answer carries."""
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the library's name
        """Keep the terminal for the run."""

    def _send(self, content: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def _stream(self, events: Iterator[Event | None]) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream; charset=utf-8")
        self.send_header("Connection", "close")
        self.end_headers()
        if self.command == "HEAD":
            return
        with contextlib.suppress(OSError):  # the browser has gone, or takes nothing in
            self.wfile.write(b"retry: 1000\n\n")
            for event in events:
                self.wfile.write(encoded(event))


def encoded(event: Event | None) -> bytes:
    """Return an event as a server-sent event; None as a comment."""
    if event is None:
        return b": nothing new\n\n"
    name, data = event
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return f"event: {name}\ndata: {text}\n\n".encode()


def local_url(scheme: str, host: str, port: int) -> str:
    """Return where a program on this machine finds a server that is bound to a host."""
    shown = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"{scheme}://{f'[{shown}]' if ':' in shown else shown}:{port}"


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
