"""The page of a running replay: pause, speed, hurry on, save the map, the words of a day, the wheels' path."""

from __future__ import annotations

import base64
import json
import threading
from collections.abc import Iterator

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.live import LogSource, Tracker, Viewer, run_live
from curvescan.live.server import PageServer
from curvescan.odometry import StepOutcome
from tests.live.chromium import chromium


@pytest.fixture(scope="module")
def log() -> cs.Log:
    return cs.simulate("room", sensor="spinning-360", n_scans=60)


def test_a_replay_pauses_hurries_on_and_keeps_its_scans(log: cs.Log) -> None:
    source = LogSource(log, speed=0)
    source.is_paused = True
    given: list[cs.LaserScan] = []
    with source:
        thread = threading.Thread(target=lambda: [given.append(scan) for scan in source.scans()], daemon=True)
        thread.start()
        thread.join(0.3)
        assert given == []
        source.skip_to = 20
        thread.join(1.0)
        assert thread.is_alive()
        assert len(given) == 20  # it stops again there
        source.is_paused = False
        thread.join(10.0)
    assert [scan.stamp for scan in given] == [scan.stamp for scan in log]


def test_a_paused_replay_ends_when_it_is_closed(log: cs.Log) -> None:
    source = LogSource(log)
    source.is_paused = True
    thread = threading.Thread(target=lambda: list(source.scans()), daemon=True)
    with source:
        thread.start()
    thread.join(5.0)
    assert not thread.is_alive()


def test_only_a_replay_has_a_pace_and_what_is_none_is_refused(log: cs.Log) -> None:
    source = LogSource(log)
    viewer = Viewer("a", replay=source)
    answer = json.loads(viewer.act("pace", {"speed": 5, "is_paused": True, "to": 12})[0])
    assert answer == {"speed": 5.0, "is_paused": True}
    assert (source.speed, source.is_paused, source.skip_to) == (5.0, True, 12)
    for wrong in (
        {"speed": "fast"},
        {"speed": -1},
        {"speed": float("nan")},
        {"is_paused": 1},
        {"to": -3},
        {"to": True},
    ):
        with pytest.raises(InvalidArgumentError, match="must be"):
            viewer.act("pace", wrong)
    with pytest.raises(InvalidArgumentError, match="an earlier scan must have been tracked"):
        viewer.act("earlier", {"to": 0})
    with pytest.raises(InvalidArgumentError, match="there is no map to save"):
        viewer.act("save", {})
    viewer.close()
    laser = Viewer("b")
    assert laser.actions == {"save"}
    with pytest.raises(InvalidArgumentError, match="may not ask for pace"):
        laser.act("pace", {"speed": 2})
    laser.close()


@pytest.fixture
def running(log: cs.Log, tmp_path) -> Iterator[tuple[PageServer, LogSource, threading.Thread]]:
    source = LogSource(log, speed=0)
    source.is_paused, source.skip_to = True, 25
    tracker = Tracker(cs.Slam(), log.odometry.poses)
    viewer = Viewer(source.name, mode="SLAM", is_lossless=True, replay=source)
    viewer.offer(tracker)
    viewer.set_status("running", "running")
    with PageServer(viewer) as server:
        thread = threading.Thread(target=lambda: run_live(source, tracker, [viewer]), daemon=True)
        thread.start()
        yield server, source, thread
        source.is_paused = False
        thread.join(60.0)
        viewer.close()


@pytest.mark.slow
def test_the_page_is_an_instrument(running, tmp_path, log: cs.Log) -> None:
    server, source, thread = running
    with chromium() as page:
        page.open(server.url)
        page.wait("typeof state === 'object' && state.scan && state.scan.index === 24", timeout=120.0)
        assert page.run("document.getElementById('outcome-text').textContent") == "Tracking"
        # the sentence is read on hover
        sentences = [outcome.value for outcome in StepOutcome]
        assert page.run("document.getElementById('outcome').title").split(" One direction")[0] in sentences
        page.wait("!document.getElementById('dock').hidden && document.getElementById('time').max === '59'")
        assert page.run("document.getElementById('play').getAttribute('aria-label')") == "Go on"
        # the wheels' path begins where the sensor's does
        page.wait("state.wheels.length === 50")
        assert np.hypot(*page.run("state.wheels.slice(0, 2)")) < 1e-3
        read = (
            "post('save', {}).then((r) => r.arrayBuffer()).then((b) => btoa(String.fromCharCode(...new Uint8Array(b))))"
        )
        (tmp_path / "saved.csmap").write_bytes(base64.b64decode(page.run(read)))
        assert 2 <= len(cs.load_map(tmp_path / "saved.csmap")) <= 25
        # on to a scan, then on to the end
        slider = "const t = document.getElementById('time'); t.value = {}; t.dispatchEvent(new Event('change'))"
        to = f"(() => {{{{ {slider} }}}})()"
        for n_scans in (30, 40):
            page.run(to.format(n_scans))
            page.wait(f"state.scan.index === {n_scans - 1}", timeout=120.0)  # kernels may compile on the way
        assert thread.is_alive()
        # back: an earlier scan where it was tracked, while the replay waits
        page.run(to.format(29))
        page.wait("state.isBack && state.scan.index === 29")
        assert page.run("document.getElementById('clock').textContent") == "30 / 60"
        assert page.run("document.getElementById('message').textContent").startswith("Scan 30 as it was tracked.")
        assert source.is_paused
        then = np.array(page.run("state.scan.pose"))
        np.testing.assert_allclose(then, se2.between(log.truth.poses[0], log.truth.poses[29]), atol=0.05)
        picture = page.call("Page.captureScreenshot", format="png")["data"]
        (tmp_path / "back.png").write_bytes(base64.b64decode(picture))
        page.run(to.format(3))  # from before the page was opened
        page.wait("state.isBack && state.scan.index === 3")
        # and on again from the newest
        page.run(to.format(45))
        page.wait("!state.isBack && state.scan.index === 44")
        assert page.run("document.getElementById('message').hidden")
        page.run("const s = document.getElementById('speed'); s.value = '20'; s.dispatchEvent(new Event('change'))")
        page.wait("document.getElementById('message').hidden")
        assert source.speed == 20.0
        page.run("document.getElementById('play').click()")
        page.wait("state.scan.index === 59", timeout=60.0)
        assert page.log == []
