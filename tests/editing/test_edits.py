"""Edits of a map: what they do, that they are replayed to the bit, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

from curvescan import InvalidArgumentError, LogFileError, LogFormatError, load_map, simulate
from curvescan.editing.edits import Edit, added, ask_match, edit_of, edited, edits_text, read_edits, save_map_folder
from curvescan.slam.pose_graph.graph import EdgeKind
from tests.editing.ring import N, false_closure, ring


def error_of(slam_map, truth):
    return float(np.hypot(*(slam_map.poses - truth)[:, :2].T).max())


def test_a_false_closure_bends_the_map_and_dropping_it_mends_it():
    slam_map, truth = ring()
    good = edited(slam_map, [Edit(do="pin", i=1, j=1)])  # optimized as it is
    bent = edited(slam_map, [false_closure()])
    assert error_of(bent, truth) > 1.0
    mended = edited(bent, [Edit(do="drop", i=33, j=5)])  # either way round
    # steps of 1 cm and 0.2 degrees over half a ring of 30 m leave some centimetres
    assert error_of(mended, truth) < 0.15
    assert abs(error_of(mended, truth) - error_of(good, truth)) < 0.02
    assert mended.grid is None
    assert (np.linalg.eigvalsh(mended.covariances[1:]) > 0.0).all()


def test_no_edit_changes_no_bit():
    slam_map, _ = ring()
    assert edited(slam_map, []) is slam_map


def test_a_pinned_keyframe_stays_where_it_was_said_to_be():
    slam_map, truth = ring()
    pinned = edited(slam_map, [Edit(do="pin", i=30, j=30, pose=tuple(truth[30].tolist()))])
    np.testing.assert_allclose(
        pinned.poses[30, :2], truth[30, :2], atol=0.01
    )  # a millimetre against the odometry's pull
    assert np.abs(pinned.poses[0]).max() == 0.0


def test_what_was_put_in_by_hand_holds_in_the_edits_that_follow(tmp_path):
    slam_map, _ = ring()
    moved = slam_map.poses[30] + [0.4, -0.3, 0.0]
    edited(slam_map, [Edit(do="pin", i=30, j=30, pose=tuple(moved.tolist()))]).save(tmp_path / "map.csmap")
    pinned = load_map(tmp_path / "map.csmap")
    closures = pinned.ends[pinned.kinds == EdgeKind.CLOSURE]
    for edit in (Edit(do="drop", i=int(closures[0, 0]), j=int(closures[0, 1])), Edit(do="forbid", i=0, j=N - 1)):
        np.testing.assert_allclose(edited(pinned, [edit]).poses[30, :2], moved[:2], atol=0.01)
    again = edited(pinned, [Edit(do="pin", i=30, j=30, pose=tuple(slam_map.poses[30].tolist()))])
    np.testing.assert_allclose(again.poses[30, :2], slam_map.poses[30, :2], atol=0.01)


def test_a_forbidden_stretch_has_no_closure():
    slam_map, _ = ring()
    free = edited(slam_map, [Edit(do="forbid", i=N - 1, j=N - 4)])
    ends = free.ends[free.kinds == EdgeKind.CLOSURE]
    assert len(ends) == 2
    assert not ((ends >= N - 4) & (ends < N)).any()


def test_a_file_of_edits_is_replayed_to_the_bit(tmp_path):
    slam_map, truth = ring()
    edits = [false_closure(), Edit(do="drop", i=5, j=33), Edit(do="pin", i=9, j=9, pose=tuple(truth[9].tolist()))]
    (tmp_path / "edits.json").write_text(edits_text(edits))
    again = read_edits(tmp_path / "edits.json")
    assert again == tuple(edits)
    assert edits_text(again) == (tmp_path / "edits.json").read_text()
    one, other = edited(slam_map, edits), edited(slam_map, again)
    assert save_map_folder(tmp_path / "one", one, edits) == save_map_folder(tmp_path / "other", other, again)
    for name in ("map.csmap", "map.pgm", "graph.g2o"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "other" / name).read_bytes()
    assert len(load_map(tmp_path / "one" / "map.csmap")) == N


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (Edit(do="drop", i=1, j=40), "no closure between"),
        (Edit(do="drop", i=1, j=2), "no closure between"),  # a step is none
        (Edit(do="pin", i=0, j=0), "pinned already"),
        (Edit(do="forbid", i=0, j=N), "keyframes 0 to 59"),
        (Edit(do="add", i=3, j=3, pose=(0, 0, 0), covariance=(1,) * 9), "3 twice"),
    ],
)
def test_what_the_map_does_not_have_is_refused(edit, message):
    with pytest.raises(InvalidArgumentError, match=message):
        edited(ring()[0], [edit])


@pytest.mark.parametrize(
    "values",
    [
        {"do": "burn", "i": 1, "j": 2},
        {"do": "drop", "i": "one", "j": 2},
        {"do": "drop", "i": 1.9, "j": 2},
        {"do": "drop", "i": float("inf"), "j": 2},
        {"do": "drop"},
        {"do": "add", "i": 1, "j": 2},
        {"do": "add", "i": 1, "j": 2, "pose": [0, 0], "covariance": [1] * 9},
        {"do": "add", "i": 1, "j": 2, "pose": [0, 0, float("nan")], "covariance": [1] * 9},
        {"do": "pin", "i": 1, "out": "/etc/passwd"},
    ],
)
def test_nonsense_is_no_edit(values):
    with pytest.raises(InvalidArgumentError):
        edit_of(values)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"curvescan_edits": 2, "edits": []}', '{"curvescan_edits": 1}', "["])
def test_a_file_of_something_else_is_refused(tmp_path, text):
    (tmp_path / "edits.json").write_text(text)
    with pytest.raises(LogFormatError, match="no file of edits"):
        read_edits(tmp_path / "edits.json")
    with pytest.raises(LogFileError, match="cannot read"):
        read_edits(tmp_path / "none.json")


@pytest.mark.slow
def test_a_closure_is_added_as_the_matcher_finds_it():
    slam_map, _ = ring()
    log = simulate("office-floor", sensor="spinning-360", n_scans=12)
    slam_map = replace(slam_map, scans=tuple(log[k % 12] for k in range(N)))
    result, edit = ask_match(slam_map, 0, 10)
    assert result.ok
    assert edit == added(slam_map, 0, 10) == edit_of(json.loads(edits_text([edit]))["edits"][0])
    empty = replace(log[0], ranges=np.full(len(log[0]), np.inf))
    with pytest.raises(InvalidArgumentError, match="cannot be joined"):
        added(replace(slam_map, scans=(log[0], empty, *slam_map.scans[2:])), 0, 1)
