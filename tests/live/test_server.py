"""The page's server, asked by browsers and by people who mean harm."""

import http.client
import json
import socket
import threading
import time
from contextlib import ExitStack, closing

import pytest

from curvescan import Odometry, OutputError, simulate
from curvescan.live import LogSource, Tracker, Viewer, run_live
from curvescan.live import server as server_module
from curvescan.live.server import PageServer

ORIGIN = "http://127.0.0.1"


@pytest.fixture(scope="module")
def page():
    viewer = Viewer("<script>alert(1)</script>", is_lossless=True)
    log = simulate("room", sensor="spinning-360", n_scans=20)
    run_live(LogSource(log, speed=0), Tracker(Odometry()), [viewer])
    viewer.close()
    with PageServer(viewer) as server:
        yield server


def ask(page, path="/", method="GET", headers=None):
    with closing(http.client.HTTPConnection(*page.address, timeout=5)) as connection:
        connection.request(method, path, headers=headers or {})
        answer = connection.getresponse()
        content = answer.read() if path != "/events" else b""
        answer.close()
    return answer, content


def raw(page, data, wait=1.0):
    with socket.create_connection(page.address, timeout=wait) as connection:
        connection.sendall(data)
        received = b""
        try:
            while chunk := connection.recv(4096):
                received += chunk
        except (TimeoutError, ConnectionError):
            pass
        return received


def events(page, n, timeout=5):
    """The first n events of a new browser."""
    with socket.create_connection(page.address, timeout=timeout) as connection:
        connection.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        text = b""
        while text.count(b"\ndata: ") < n or not text.endswith(b"\n\n"):
            text += connection.recv(65536)
    blocks = [block.split("\n") for block in text.decode().split("\n\n") if block.startswith("event: ")]
    return [(b[0].removeprefix("event: "), json.loads(b[1].removeprefix("data: "))) for b in blocks]


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/", "text/html"),
        ("/page.js", "text/javascript"),
        ("/page.css", "text/css"),
        ("/icon.svg", "image/svg"),
        ("/map.png", "image/png"),
        ("/map.png?17", "image/png"),
    ],
)
def test_what_is_there(page, path, kind):
    answer, content = ask(page, path)
    assert answer.status == 200
    assert answer.getheader("Content-Type").startswith(kind)
    assert len(content) == int(answer.getheader("Content-Length")) > 0
    head, empty = ask(page, path, "HEAD")
    assert (head.status, empty) == (200, b"")
    assert head.getheader("Content-Length") == answer.getheader("Content-Length")


def test_the_page_needs_no_other_machine(page):
    for path in ("/", "/page.js", "/page.css"):
        _, content = ask(page, path)
        assert b"http:" not in content.replace(b"http://www.w3.org", b"")
        assert b"https:" not in content
    answer, _ = ask(page, "/")
    policy = answer.getheader("Content-Security-Policy")
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert answer.getheader("X-Content-Type-Options") == "nosniff"
    assert answer.getheader("Access-Control-Allow-Origin") is None


def test_a_late_browser_gets_path_and_map_first(page):
    names = [name for name, _ in events(page, 6)]
    assert names == ["about", "status", "path", "map", "times", "scan"]


def test_a_name_is_data_and_never_markup(page):
    (_, about), *_ = events(page, 1)
    assert about["name"] == "<script>alert(1)</script>"
    _, script = ask(page, "/page.js")
    assert b"innerHTML" not in script  # what the server tells is set as text


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd",
        "/..%2f..%2fetc%2fpasswd",
        "/%2e%2e/pyproject.toml",
        "/page.html/../server.py",
        "/server.py",
        "//etc/passwd",
        "/page.js%00.png",
        "/map.png/",
        "/" + "a" * 5000,
        "/?file=/etc/passwd&out=/tmp/x",
        "*",
    ],
)
def test_no_file_of_the_visitors_choosing(page, path):
    answer, content = ask(page, path)
    assert b"root:" not in content
    assert answer.status == (200 if path.startswith("/?") else 404)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "BREW"])
def test_nothing_is_written(page, method):
    answer, _ = ask(page, "/", method)
    assert answer.status in (405, 501)


@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("localhost", 200),
        ("localhost:8765", 200),
        ("127.0.0.1", 200),
        ("[::1]:80", 200),
        ("evil.example", 421),
        ("127.0.0.1.evil.example", 421),
        ("localhost.evil.example", 421),
        ("", 421),
    ],
)
def test_another_sites_name_for_this_machine_is_refused(page, name, status):
    assert ask(page, "/", headers={"Host": name})[0].status == status
    assert ask(page, "/events", headers={"Host": name})[0].status == status


@pytest.mark.parametrize(
    "data",
    [
        b"\r\n\r\n",
        b"GET\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil\r\n\r\n",
        b"GET /" + b"a" * 70_000 + b" HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 200 + b"\r\n",
        b"GET / HTTP/1.1\r\nX: " + b"a" * 70_000 + b"\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(range(256)),
        bytes(range(256)) * 40,
        b"GET /\xff\xfe HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999999999\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nffffffff\r\n",
    ],
)
def test_nonsense_is_refused_and_the_page_stays(page, data):
    answer = raw(page, data)
    assert b"Traceback" not in answer
    assert ask(page, "/")[0].status == 200


def test_two_requests_in_one_are_not_smuggled(page):
    answer = raw(
        page,
        b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 40\r\n\r\n"
        b"GET /map.png HTTP/1.1\r\nHost: localhost\r\n\r\n",
    )
    assert answer.count(b"HTTP/1.1 ") == 1


def test_a_visitor_who_says_nothing_is_cut_off_and_holds_up_nobody(page, monkeypatch):
    monkeypatch.setattr(server_module._Handler, "timeout", 0.3)
    with ExitStack() as stack:
        idle = [stack.enter_context(socket.create_connection(page.address)) for _ in range(20)]
        assert ask(page, "/")[0].status == 200
        for connection in idle:
            connection.settimeout(3)
            assert connection.recv(10) == b""


def test_too_many_visitors_are_turned_away_and_room_comes_back(page, monkeypatch):
    monkeypatch.setattr(server_module._Handler, "timeout", 30.0)
    with ExitStack() as idle:
        for _ in range(server_module.MAX_CONNECTIONS + 5):
            idle.enter_context(socket.create_connection(page.address))
        with pytest.raises((ConnectionError, http.client.HTTPException)):
            ask(page, "/")
    time.sleep(0.5)
    assert ask(page, "/")[0].status == 200


@pytest.mark.slow
def test_a_browser_that_reads_nothing_holds_up_neither_the_run_nor_others():
    viewer = Viewer("slow browser", is_lossless=True)
    log = simulate("room", sensor="spinning-360", n_scans=150)
    with PageServer(viewer) as server:
        lazy = socket.create_connection(server.address)
        lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        lazy.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        started = time.monotonic()
        report = run_live(LogSource(log, speed=0), Tracker(Odometry()), [viewer])
        assert report.n_scans == len(log)
        assert time.monotonic() - started < 30.0
        assert dict(events(server, 6))["scan"]["index"] > 0
        viewer.close()
        lazy.close()


def test_the_stream_ends_with_the_viewer():
    viewer = Viewer("ends")
    with PageServer(viewer) as server:
        threading.Timer(0.3, viewer.stop).start()
        answer = raw(server, b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n", wait=5.0)
    assert b"event: about" in answer
    viewer.close()


def test_an_address_in_use(page):
    viewer = Viewer("second")
    with pytest.raises(OutputError, match="cannot serve the page"):
        PageServer(viewer, port=page.address[1])
    with pytest.raises(OutputError, match="cannot serve the page"):
        PageServer(viewer, host="192.0.2.1")
    viewer.close()
