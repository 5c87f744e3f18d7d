"""A results folder on the page: what it says, and that a browser shows it."""

import csv
import json
import shutil
import zlib

import numpy as np
import pytest

import curvescan as cs
from curvescan.live.finished.results_folder import read_results
from curvescan.live.finished.view import packed
from tests.live.chromium import chromium

pytestmark = pytest.mark.slow


def unpacked(data):
    data = zlib.decompress(data)
    length = int.from_bytes(data[:4], "little")
    types = {
        "Float32Array": "<f4",
        "Float64Array": "<f8",
        "Uint8Array": "u1",
        "Uint16Array": "<u2",
        "Int32Array": "<i4",
    }

    def revived(value):
        if "array" not in value:
            return value
        return np.frombuffer(data, types[value["array"]], value["n"], 4 + length + value["at"])

    return json.loads(data[4 : 4 + length], object_hook=revived)


def test_arrays_come_back_as_they_were_each_where_a_browser_can_read_it():
    tree = {"a": np.arange(3, dtype=np.uint8), "b": [np.array([0.5, np.nan]), None, "ü"], "c": {"d": b"\x01\x02"}}
    found = unpacked(packed(tree))
    assert found["a"].tolist() == [0, 1, 2]
    np.testing.assert_array_equal(found["b"][0], tree["b"][0])
    assert found["b"][1:] == [None, "ü"]
    assert bytes(found["c"]["d"]) == b"\x01\x02"


def test_every_closure_that_was_tried_is_there_with_its_sentence(results):
    run = read_results(results)
    closures, tree = run.tree["closures"], run.tree
    with (results / "closures.csv").open() as file:
        tried = list(csv.DictReader(file))
    sentences = {text for _, text, _, _ in closures["kinds"]}
    assert {c["meaning"] for c in tried} <= sentences
    assert len(closures["kind"]) >= len(tried) > 0
    assert sum(n for *_, n in closures["kinds"]) == len(closures["kind"])
    # both ends lie where the keyframes do
    i, j = closures["rows"][0]
    np.testing.assert_allclose(closures["places"][:4], np.ravel(tree["keyframes"][[i, j], :2]))
    told = json.loads((results / "run.json").read_text())["slam"]["loop_closures"]
    accepted = [n for name, _, is_accepted, n in closures["kinds"] if is_accepted and "(" not in name]
    assert sum(accepted) == told


def test_scans_odometry_and_wheels_of_the_run_are_there(results):
    tree = read_results(results).tree
    n = len(tree["stamps"])
    assert n == 120
    assert tree["odometry"].shape == tree["wheels"].shape == tree["poses"].shape == (n, 3)
    np.testing.assert_allclose(tree["wheels"][0], tree["poses"][0], atol=1e-6)
    assert tree["n_angles"][tree["layout"]].sum() == len(tree["ranges"])


def test_a_map_alone_or_a_folder_of_one_can_be_looked_at(results, tmp_path):
    tree = read_results(results / "map.csmap").tree
    shutil.copy(results / "map.csmap", tmp_path)
    assert read_results(tmp_path).tree["closures"]["kinds"] == tree["closures"]["kinds"]
    assert len(tree["poses"]) == len(cs.load_map(results / "map.csmap"))
    assert tree["closures"]["kinds"]


def test_a_folder_of_something_else_is_refused(tmp_path):
    with pytest.raises(cs.LogFileError, match=r"no results folder"):
        cs.view(tmp_path)
    with pytest.raises(cs.InvalidArgumentError, match="takes a results folder"):
        cs.view(3)


@pytest.mark.parametrize(
    ("damaged", "fault"),
    [
        (lambda text: text[: text.rindex(b",")], "a row has no meaning"),
        (lambda text: text.replace(b",", b";"), "a row has no keyframe_i"),
        (lambda text: text.replace(b"loop", b"l\xf6\xf6p"), "can't decode byte"),
        (lambda text: text.replace(b"0.", b"zero"), "could not convert string to float"),
    ],
)
def test_damaged_closures_are_a_sentence(results, tmp_path, damaged, fault):
    shutil.copytree(results, tmp_path / "out")
    path = tmp_path / "out" / "closures.csv"
    path.write_bytes(damaged(path.read_bytes()))
    with pytest.raises(cs.LogFormatError, match=rf"closures\.csv is damaged: .*{fault}"):
        cs.view(tmp_path / "out")


def test_one_file_opens_without_a_server_and_says_why_a_closure_was_accepted(results, tmp_path):
    cs.view(results, results / "map.csmap").save(tmp_path / "run.html")
    assert b"http:" not in (tmp_path / "run.html").read_bytes().replace(b"http://www.w3.org", b"")
    with chromium() as page:
        page.open((tmp_path / "run.html").as_uri())
        page.wait("document.body && document.body.dataset.ready === 'yes'")
        assert page.run("document.getElementById('clock').textContent").startswith("120 / 120")
        page.run("goTo(10)")
        assert page.run("document.getElementById('outcome').textContent").startswith("Tracking: ")
        assert page.run("pointsOf(runs[0], 10).length") > 100
        x, y = page.run("[runs[0].closures.places[0], runs[0].closures.places[1]]")
        page.run("for (const [name] of runs[0].closures.kinds) shown.add('closure ' + name)")
        page.run(f"stage.onPick(0, {x}, {y})")
        text = page.run("document.getElementById('closure').textContent")
        assert any(sentence in text for _, sentence, _, _ in read_results(results).tree["closures"]["kinds"])
        assert page.run("stage.panes.length") == 2
        assert page.log == []


def test_a_place_where_matches_contradict_the_map_has_a_ring(results, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(results, folder)
    with np.load(folder / "view.npz") as seen:
        assert seen["contradicted"].shape == (0, 2)
        np.savez(folder / "view.npz", **{**seen, "contradicted": np.array([[1.5, -2.0]], dtype=np.float32)})
    assert read_results(folder).tree["contradicted"].tolist() == [[1.5, -2.0]]
    cs.view(folder).save(tmp_path / "run.html")
    with chromium() as page:
        page.open((tmp_path / "run.html").as_uri())
        page.wait("document.body && document.body.dataset.ready === 'yes'")
        page.run("rings = []; arc = pen.arc; pen.arc = function (...a) { rings.push(a); arc.apply(this, a); }")
        page.run("drawRun(runs[0])")
        rings = page.run("rings.map(([u, v]) => [u, v, ...toScreen(1.5, -2.0)])")
        assert [(u, v) for u, v, *_ in rings] == [(x, y) for *_, x, y in rings]
        assert len(rings) == 1
        assert page.log == []
