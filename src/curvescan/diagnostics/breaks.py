"""Breaks: where a drive goes on as no scan shows it.

What breaks it and leaves covariances as they are: a scanner that repeats a scan while the sensor drives, parts of a map
that wheels alone tie though the scans on either side should match, a track that was lost, or goes on in doubt where
scans are missing, and is joined in a place that looks like others, and a step that is measured and does not go with the
loops.
"""

from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.diagnostics.inspect import are_leaps
from curvescan.diagnostics.motion_prior import SURE
from curvescan.engines import RunRecord
from curvescan.io.log import Log
from curvescan.odometry.step import StepOutcome
from curvescan.scan import LaserScan
from curvescan.slam import Slam
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.localization.correlative import contour_length
from curvescan.slam.localization.field import fields_of, lasting_points
from curvescan.slam.localization.search import MapSearch, said
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Bools, Ints, Pose

_STILL = 0.02  # a sensor stands that moves and turns by no more, metres and radians
_NEAR = 0.5  # scans so near to each other see the same, metres and radians
_N_SCANS = 5  # scans after a break in which the track is found again, or lost
_N_VIEWS = 20  # most keyframes of a track, one of which at least tells its place, where there are half as many
_TIMES, _USUAL = 3, 0.95  # a leap is so many times as long as this quantile of the steps


class Break(NamedTuple):
    """A break: first and last scan of what is wrong, and the metres that no scan shows."""

    kind: str  # "frozen", "untied", "ambiguous" or "torn"
    first: int
    last: int
    metres: float


def find_frozen(record: RunRecord, most: float, wheels: Pose | None) -> list[Break]:
    """Return where a scanner froze for longer than `most`, metres; wheels (n, 3): where they are used."""
    n = len(record.outcomes)
    way = np.concatenate(([0.0], np.hypot(*np.diff(record.trajectory.poses[:, :2], axis=0).T)))
    usual = float(np.quantile(way[1:], _USUAL)) if n > 1 else 0.0
    leaps = np.where(way > max(_TIMES * usual, most), way, 0.0)
    found = []
    begins = _begins(record.is_failed) | _begins(record.is_degenerate) | (way > _TIMES * usual)
    for k in (*np.flatnonzero(begins).tolist(), n):
        begin = _stands_since(record.odometry.poses[:k])
        off = [] if wheels is None else np.hypot(*(wheels[begin:k, :2] - wheels[begin, :2]).T)
        driven = float(np.nan_to_num(off, posinf=0.0).max(initial=0.0))
        leap = float(leaps[k : k + _N_SCANS].max(initial=0.0))
        n_seen = np.count_nonzero(~record.is_failed[begin + 1 : k])  # blind is not frozen
        if driven > most or 0.0 < leap <= usual * n_seen:
            found.append(Break("frozen", begin, k - 1, driven if driven > most else leap))
    return found


def find_untied(record: RunRecord, wheels: Pose, log: Log, slam_map: SlamMap) -> list[Break]:
    """Return where wheels (n, 3) alone tie two parts of a map though the scans on either side should match."""
    begins = (k for k in np.flatnonzero(_begins(record.is_failed)).tolist() if _is_untied(record, k, wheels, slam_map))
    return [Break("untied", k, k, 0.0) for k in begins if 2 * log[k].valid.sum() > record.n_matched[k - 1]]


def find_ambiguous(record: RunRecord, slam_map: SlamMap, keyframes: Keyframes) -> list[Break]:
    """Return where a track was joined that was lost, or in doubt, in a place like others.

    There nothing seen since matches tied it to what was before tells its place there from others; keyframes: the map's.
    """
    views: dict[int, list[int]] = {}
    for k, n_least in sorted(joins_in_doubt(record)):
        tied, scans = _tied_since(slam_map, k)
        rows = np.flatnonzero(scans >= tied.min()).tolist()[:_N_VIEWS] if tied.size else []
        if len(rows) >= n_least:  # views of fewer keyframes are no reason to doubt
            views[k] = rows
    if not views:
        return []
    n_known = np.searchsorted(scans, [max(k - _N_SCANS, 0) for k in views], side="right").tolist()
    found, fields = [], fields_of(slam_map, n_known)
    for k, n in zip(views, n_known, strict=True):
        search = MapSearch(next(fields), slam_map.poses[:n], keyframes)
        if not any(_tells(search, slam_map.scans[row], slam_map.poses[row]) for row in views[k]):
            found.append(Break("ambiguous", k, k, 0.0))
        del search  # the field of a large map takes much memory: the next one is made without it
    return found


def joins_in_doubt(record: RunRecord) -> list[tuple[int, int]]:
    """Return the scans from which on a track had to be joined, and of how many views one at least must tell its place.

    After a loss, and where scans are missing, no wheels bridge them and no sure match does.
    """
    is_leap = are_leaps(np.diff(record.trajectory.stamps, prepend=np.nan), record.scan_period)
    in_doubt = np.flatnonzero(is_leap & ~(record.confidence >= SURE) & (not record.has_prior)).tolist()
    lost = [k for k, outcome in enumerate(record.outcomes) if outcome is StepOutcome.LOST]
    return [(k, _N_VIEWS // 2) for k in lost] + [(k, 1) for k in in_doubt]


def find_torn(engine: Slam, most: float, *, has_wheels: bool) -> list[Break]:
    """Return the steps of this session that a match or wheels measured and closures refuse by more than `most`."""
    graph, session = engine.graph, engine.keyframes[-1].session
    is_measured = (graph.kinds == EdgeKind.MATCH) | (has_wheels & (graph.kinds == EdgeKind.MOTION))
    is_new = np.array([keyframe.session == session for keyframe in engine.keyframes])[graph.ends].all(axis=1)
    rows = np.flatnonzero(is_measured & is_new & ~graph.is_followed)
    i, j = graph.ends[rows].T
    off = se2.between(graph.measured[rows], se2.between(graph.poses[i], graph.poses[j]))
    scans = np.array([keyframe.index for keyframe in engine.keyframes])
    torn = zip(scans[i].tolist(), scans[j].tolist(), np.hypot(off[:, 0], off[:, 1]).tolist(), strict=True)
    return [Break("torn", first, last, metres) for first, last, metres in torn if metres > most]


def _begins(mask: Bools) -> Bools:
    """Return (n,) where a run of True begins, after the first."""
    return mask & ~np.concatenate(([True], mask[:-1]))


def _is_untied(record: RunRecord, k: int, wheels: Pose, slam_map: SlamMap) -> bool:
    """Return whether scan k should match the one before it, does not, and nothing else ties the parts on its sides."""
    motion = np.abs(se2.between(wheels[k - 1], wheels[k]))
    if StepOutcome.RELOCALIZED in record.outcomes[k : k + _N_SCANS] or not (motion < _NEAR).all():
        return False
    return not _tied_since(slam_map, k)[0].size


def _tells(search: MapSearch, scan: LaserScan, pose: Pose) -> bool:
    """Return whether a scan alone speaks clearly more for a (3,) pose in a map than for any other place."""
    points = lasting_points(scan)
    view = said(contour_length(points), search.field.agreement(points, pose))
    return search.look(scan).is_best(pose, view.by_walls)


def _tied_since(slam_map: SlamMap, k: int) -> tuple[Ints, Ints]:
    """Return the scans from k on that matches tie to some before it, and of all keyframes; 0 for earlier sessions."""
    scans = np.where(slam_map.sessions == slam_map.n_sessions - 1, slam_map.indices, 0)
    ends = scans[slam_map.ends[(slam_map.kinds != EdgeKind.MOTION) & (slam_map.weights > 0.5)]]
    return ends.max(axis=1)[(ends.min(axis=1) < k) & (ends.max(axis=1) >= k)], scans


def _stands_since(poses: Pose) -> int:
    """Return the scan since which a sensor has stood where it is at the last of the (n, 3) poses."""
    off = np.abs(poses - poses[-1])
    off[:, 2] = np.abs(se2.wrap(off[:, 2]))
    moved = np.flatnonzero(~(off < _STILL).all(axis=1))
    return int(moved[-1]) + 1 if moved.size else 0
