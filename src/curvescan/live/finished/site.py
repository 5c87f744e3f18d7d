"""FinishedSite: the page of finished runs for the server, and the mending of a map on it.

It keeps no state: with each request the page sends all its edits, so that undo is one edit less, and what it shows is
what a replay of the same edits gives.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from operator import index
from typing import Any

import numpy as np

from curvescan import se2
from curvescan.editing.edits import ask_match, edit_of, edited, edits_text, plain_edit
from curvescan.errors import InvalidArgumentError
from curvescan.live.finished.results_folder import FinishedRun, revised_tree
from curvescan.live.finished.view import FinishedView, packed
from curvescan.live.live_map import map_file
from curvescan.slam.map import SlamMap

_BYTES, _JSON = "application/octet-stream", "application/json"
_MAX_EDITS = 1000


class FinishedSite:
    """What the page of finished runs shows, and what it may ask for: the first run can be mended if it has a map."""

    page = "view"

    def __init__(self, view: FinishedView) -> None:
        self._run: FinishedRun = view.runs[0]
        is_mendable = self._run.slam_map is not None
        self.actions = frozenset(("match", "optimize", "map", "edits") if is_mendable else ())
        self._data = packed({"runs": [run.tree for run in view.runs], "can_mend": is_mendable})

    def content(self, path: str) -> tuple[bytes, str] | None:
        """Return the runs."""
        return (self._data, _BYTES) if path == "/data" else None

    def events(self) -> None:
        """Return no stream: what is finished stays."""

    def stop(self) -> None:
        """Do nothing: there is no stream."""

    def act(self, name: str, arguments: Mapping[str, Any]) -> tuple[bytes, str]:
        """Do what the page asks for: nothing is written here, maps and edits go to the browser."""
        slam_map = self._run.slam_map
        assert slam_map is not None, "without a map there are no actions"
        if name == "match":
            return json.dumps(_answer(slam_map, index(arguments["i"]), index(arguments["j"]))).encode(), _JSON
        values = arguments["edits"]
        if not isinstance(values, list) or len(values) > _MAX_EDITS or not all(isinstance(v, dict) for v in values):
            raise InvalidArgumentError(f"edits must be a list of at most {_MAX_EDITS} objects")
        edits = [edit_of(value) for value in values]
        if name == "edits":
            return edits_text(edits).encode(), _JSON
        mended = edited(slam_map, edits)
        if name == "optimize":
            return packed(revised_tree(self._run, mended)), _BYTES
        return map_file(replace(mended, grid=mended.occupancy())), _BYTES


def _answer(slam_map: SlamMap, i: int, j: int) -> dict[str, Any]:
    """Return what the matcher says of two keyframes, and the later scan where it puts it in the map, centimetres."""
    result, edit = ask_match(slam_map, i, j)
    sentence = result.outcome.value
    if edit is None or edit.pose is None:
        return {"edit": None, "sentence": sentence}
    scan, pose = slam_map.scans[j], se2.compose(slam_map.poses[i], np.array(edit.pose))
    moved = se2.between(slam_map.poses[j], pose)
    confidence = "" if np.isnan(result.confidence) else f" Confidence {result.confidence:.3f}."
    return {
        "edit": plain_edit(edit),
        "sentence": f"{sentence}{confidence} It moves keyframe {j} by {np.hypot(*moved[:2]):.2f} m and "
        f"{abs(np.degrees(moved[2])):.1f} deg.",
        "pose": pose.tolist(),
        "points": np.rint(100.0 * scan.points[scan.valid]).ravel().tolist(),
    }
