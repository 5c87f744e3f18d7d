"""Mending on the page: by the page, in a browser, and by nobody else."""

import base64
import http.client
import json
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from curvescan import load_map
from curvescan.cli.main import run
from curvescan.editing.edits import edited, read_edits
from curvescan.live.finished.site import FinishedSite
from curvescan.live.finished.view import view
from curvescan.live.server import MAX_BODY, PageServer
from tests.editing.ring import false_closure, ring
from tests.live.chromium import chromium


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    """A map with one false closure forced in, and the error that it makes."""
    path = tmp_path_factory.mktemp("bent") / "bent.csmap"
    replace(edited(ring()[0], [false_closure()]), grid=None).save(path)
    return path


@pytest.fixture(scope="module")
def server(bent):
    with PageServer(FinishedSite(view(bent))) as served:
        yield served


def ask(server, path, method="POST", body=b"{}", **headers):
    with closing(http.client.HTTPConnection(*server.address, timeout=30)) as connection:
        connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        return answer.status, answer.read()


def token_of(server):
    return ask(server, "/token", "GET")[1].decode()


def test_the_page_itself_may_mend(server):
    body = json.dumps({"edits": [{"do": "drop", "i": 5, "j": 33}]}).encode()
    given = {"Content_Type": "application/json", "X_Curvescan_Token": token_of(server)}
    status, text = ask(server, "/do/edits", body=body, **given)
    assert status == 200
    assert json.loads(text)["edits"] == [{"do": "drop", "i": 5, "j": 33}]
    own = "http://{}:{}".format(*server.address)
    assert ask(server, "/do/edits", body=body, Origin=own, **given)[0] == 200


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "http://localhost:1"}, 403),
        ({"Host": "evil.example"}, 421),
        ({"X_Curvescan_Token": "guess"}, 403),
        ({"X_Curvescan_Token": ""}, 403),
        ({"Content_Type": "text/plain"}, 403),  # what a form of another site can send
        ({"Content_Type": "application/x-www-form-urlencoded"}, 403),
        ({"Content_Length": str(MAX_BODY + 1)}, 413),
        ({"Content_Length": "-1"}, 413),
    ],
)
def test_nobody_else_may(server, change, status):
    given = {"Content_Type": "application/json", "X_Curvescan_Token": token_of(server)}
    assert ask(server, "/do/edits", body=b'{"edits": []}', **{**given, **change})[0] == status


@pytest.mark.parametrize(
    "body",
    [b"", b"[]", b"{", b'{"edits": 3}', b'{"edits": [3]}', b'{"edits": [{"do": "drop", "i": 1, "j": 2}]}', b"[" * 9000],
)
def test_nonsense_is_answered_with_a_sentence(server, body):
    given = {"Content_Type": "application/json", "X_Curvescan_Token": token_of(server)}
    status, text = ask(server, "/do/optimize", body=body, **given)
    assert (status, list(json.loads(text))) == (422, ["error"])


def test_there_is_no_other_action_and_none_where_others_may_look_on(server, bent):
    given = {"Content_Type": "application/json", "X_Curvescan_Token": token_of(server)}
    for path in ("/do/delete", "/do/", "/do/map/../../etc", "/data", "/"):
        assert ask(server, path, **given)[0] == 405
    with PageServer(FinishedSite(view(bent)), host="0.0.0.0") as open_server:
        assert ask(open_server, "/token", "GET")[0] == 404
        assert ask(open_server, "/do/edits", **given)[0] == 405


def test_a_false_closure_is_dropped_in_a_browser_and_the_file_replays_to_the_bit(server, bent, tmp_path):
    _, truth = ring()
    with chromium() as page:
        page.open(server.url)
        page.wait("document.body && document.body.dataset.ready === 'yes'")
        error = (
            "Math.max(...Array.from(runs[0].poses.filter((_, k) => k % 3 < 2)).map((v, k) => Math.abs(v - truth[k])))"
        )
        page.run(f"var truth = {truth[:, :2].ravel().tolist()}")
        assert page.run(error) > 1.0
        # the closure is picked where it is drawn, and dropped by the button that then appears
        find = "[...runs[0].closures.rows].findIndex((r, k, all) => k % 2 === 0 && r === 5 && all[k + 1] === 33) / 2"
        assert page.run(find) >= 0
        page.run(f"chosen = {{ run: runs[0], m: {find} }}; showClosure(); document.getElementById('drop').click()")
        page.wait("document.querySelectorAll('#edits li').length === 1 && document.getElementById('message').hidden")
        page.wait(f"{error} < 0.15")
        read = (
            "(async (name) => { const b = new Uint8Array("
            "await (await post(name, { edits: mending.edits })).arrayBuffer());"
            " return btoa(String.fromCharCode(...b)); })"
        )
        saved = {name: base64.b64decode(page.run(f"{read}({name!r})")) for name in ("map", "edits")}
        page.run("document.getElementById('undo').click()")
        page.wait(f"{error} > 1.0")
        assert page.log == []
    (tmp_path / "edits.json").write_bytes(saved["edits"])
    (tmp_path / "page.csmap").write_bytes(saved["map"])
    assert [edit.do for edit in read_edits(tmp_path / "edits.json")] == ["drop"]
    out = tmp_path / "out"
    assert run(["slam", "--map", str(bent), "--edits", str(tmp_path / "edits.json"), "--out", str(out)]) == 0
    assert (out / "map.csmap").read_bytes() == saved["map"]
    by_flag = tmp_path / "by-flag"
    assert run(["slam", "--map", str(bent), "--drop", "5", "33", "--out", str(by_flag)]) == 0
    assert (by_flag / "map.csmap").read_bytes() == saved["map"]
    assert np.abs(load_map(out / "map.csmap").poses - truth)[:, :2].max() < 0.15


def test_a_page_of_another_origin_cannot_mend(server, tmp_path):
    """A browser that is shown another site's page sends nothing that is done, and reads nothing."""
    (tmp_path / "evil.html").write_text("<!doctype html><body data-ready='yes'>evil</body>")
    with chromium() as page:
        page.open((tmp_path / "evil.html").as_uri())
        page.wait("document.body && document.body.dataset.ready === 'yes'")
        for how in (
            f"fetch('{server.url}token').then((r) => r.text())",
            f"fetch('{server.url}do/edits', {{method: 'POST', body: '{{}}'}}).then((r) => r.text())",
            f"fetch('{server.url}do/edits', {{method: 'POST', headers: {{'X-Curvescan-Token': 'x'}}}})"
            ".then((r) => r.text())",
        ):
            assert page.run(f"{how}.catch(() => 'refused')") == "refused"


def test_the_command_says_what_is_missing(bent, tmp_path, capsys):
    assert run(["slam", "--out", str(tmp_path / "a")]) == 1
    assert run(["slam", "--map", str(bent), "--out", str(tmp_path / "a")]) == 1
    assert capsys.readouterr().err.count("give a LOG; or --map, and what to mend in it: --drop, --add or --edits") == 2
    assert run(["slam", "--map", str(bent), "--drop", "1", "2", "--out", str(tmp_path / "b")]) == 1
    assert "no closure between keyframes 1 and 2" in capsys.readouterr().err
    assert not (tmp_path / "b").exists()
