"""The time of one more keyframe in a map of so many: a simulated drive continues maps that differ in size alone.

A map holds copies of one building, side by side and tied in a row, and one of another building, in which the drive goes
on. `python bench/one_more_keyframe.py 1000 10000 100000` prints a row for each size.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

import numpy as np

import curvescan as cs
from curvescan import se2
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind

_APART_M = 80.0
_PER_ROW = 40
_N_FIRST = 100


def main(sizes: Sequence[int]) -> None:
    """Print a table: keyframes, how many more, milliseconds of processor for each, of the other scans, the worst scan.

    The first scans, which find the place in the map, do not count.
    """
    copied, own = _map_of(0), _map_of(1)
    drive = list(cs.simulate("office-floor", n_scans=500, seed=1, n_people=1))
    rows = ["| keyframes | more | ms each | ms a scan, the rest | worst scan |", "| ---: | ---: | ---: | ---: | ---: |"]
    for n in sizes:
        slam = cs.Slam(map=_beside(copied, own, max(1, round((n - len(own)) / len(copied)))))
        counts, took = [len(slam.keyframes)], []
        for scan in drive:
            started = time.process_time()
            slam.add(scan)
            took.append(1e3 * (time.process_time() - started))
            counts.append(len(slam.keyframes))
        times, is_more = np.array(took[_N_FIRST:]), np.diff(counts)[_N_FIRST:] != 0
        each, rest = times.sum() / np.count_nonzero(is_more), times[~is_more].mean()
        rows.append(f"| {counts[0]:,} | {np.count_nonzero(is_more)} | {each:.1f} | {rest:.2f} | {times.max():.0f} |")
    sys.stdout.write("\n".join(rows) + "\n")


def _map_of(seed: int) -> SlamMap:
    slam = cs.Slam()
    for scan in cs.simulate("office-floor", n_scans=700, seed=seed):
        slam.add(scan)
    slam.finish()
    return slam.map


def _beside(copied: SlamMap, own: SlamMap, n_copies: int) -> SlamMap:
    """Return a map of one building, and copies of another beside it."""
    parts = [copied] * n_copies + [own]
    poses, ends, measured, covariances, kinds = [], [], [], [], []
    first = 0
    for k, part in enumerate(parts):
        shift = np.array([_APART_M * (k % _PER_ROW), _APART_M * (k // _PER_ROW), 0.0])
        poses.append(se2.compose(shift, part.poses))
        used = part.weights > 0.5
        ends.append(part.ends[used] + first)
        measured.append(part.measured[used])
        covariances.append(part.edge_covariances[used])
        kinds.append(part.kinds[used])
        if k:
            ends.append(np.array([[first - 1, first]]))
            measured.append(se2.between(poses[-2][-1], poses[-1][0])[np.newaxis])
            covariances.append(np.diag([1e-2, 1e-2, 1e-4])[np.newaxis])
            kinds.append(np.array([int(EdgeKind.MOTION)]))
        first += len(part)
    edges = np.concatenate(ends)
    return SlamMap(
        scans=tuple(scan for part in parts for scan in part.scans),
        poses=np.concatenate(poses),
        covariances=np.tile(np.eye(3), (first, 1, 1)),
        indices=np.concatenate([part.indices for part in parts]),
        sessions=np.zeros(first, dtype=np.int64),
        ends=edges,
        measured=np.concatenate(measured),
        edge_covariances=np.concatenate(covariances),
        kinds=np.concatenate(kinds),
        weights=np.ones(len(edges)),
    )


if __name__ == "__main__":
    main([int(size) for size in sys.argv[1:]] or [1_000, 10_000, 100_000])
