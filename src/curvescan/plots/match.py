"""The paper's figures of one match: segments (4), curvature functions (5), matched points (6 and 9)."""

import json
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from curvescan import se2
from curvescan._version import __version__
from curvescan.matchers import match
from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.matchers.cfsma.landmarks import Verdict
from curvescan.matchers.cfsma.trace import CfSmaTrace, count_gates
from curvescan.matchers.result import Label, MatchResult
from curvescan.plots.colours import DARK, FIRST, GREY, PAIRED, PATH, SECOND, segment_colour
from curvescan.plots.map import as_place, drawing, drawing_places
from curvescan.scan import LaserScan
from curvescan.types import Points

_SENSOR: dict[str, Any] = {"marker": (3, 0, -90), "color": PATH, "ms": 8.0, "ls": "none"}


def save_match(
    folder: Path, result: MatchResult, *, scans: tuple[LaserScan, LaserScan], names: tuple[str, str], cfsma: CfSmaConfig
) -> dict[str, Any]:
    """Write segments.png, curvature.png, matched.png and match.json of a match into a folder; return the last."""
    paper = result if result.method == "cfsma" else match(*scans, method="cfsma", config=cfsma)
    trace = paper.trace
    assert isinstance(trace, CfSmaTrace)
    draw_segments(folder / "segments.png", trace, names)
    draw_curvature(folder / "curvature.png", trace, names, cfsma.landmarks.min_curvature)
    draw_matched(folder / "matched.png", result, scans, names)
    weak = result.degenerate_direction
    record: dict[str, Any] = {
        "curvescan": __version__,
        "reference": names[0],
        "current": names[1],
        "method": result.method,
        "outcome": result.outcome.name.lower(),
        "meaning": result.outcome.value,
        "pose": result.pose.tolist() if result.ok else None,
        "covariance": result.covariance.tolist() if result.ok else None,
        "degenerate_direction": None if weak is None else weak.tolist(),
        "n_matched": result.n_matched,
    }
    if result.method == "cfsma":
        record |= {
            "rejections": trace.rejections(),
            "readings_reference": count_gates(trace.gates_reference),
            "readings_current": count_gates(trace.gates_current),
        }
    (folder / "match.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8", newline="\n")
    return record


def draw_segments(path: Path, trace: CfSmaTrace, names: tuple[str, str]) -> None:
    """Save the segments of both scans in colours, isolated readings in grey (figure 4)."""
    scans = (trace.reference, trace.current)
    points = np.concatenate([features.points for features in scans])
    with drawing_places(path, _with_sensor(points), 2, legend=3) as places:
        for axes, features, name in zip(places, scans, names, strict=True):
            axes.plot(*features.points.T, ".", color=GREY, ms=3, label="isolated reading")
            for k, (start, stop) in enumerate(zip(features.starts, features.stops, strict=True)):
                axes.plot(*features.points[start:stop].T, ".-", color=segment_colour(k), ms=3, lw=0.7)
            corners = features.points[features.landmarks.extents[:, 0]]
            axes.plot(*corners.T, "o", mfc="none", mec=DARK, ms=7, label="characteristic point")
            axes.plot(0, 0, **_SENSOR, label="sensor")
            as_place(axes, f"{name}: CF-SMA, {len(features.starts)} segments, {len(corners)} corners")


def draw_curvature(path: Path, trace: CfSmaTrace, names: tuple[str, str], min_curvature: float) -> None:
    """Save the curvature functions of both scans, with U_p and the characteristic points (figure 5)."""
    paired_rows = np.flatnonzero(trace.landmark_pairs.verdict == Verdict.PAIRED)
    paired = {"current": paired_rows, "reference": trace.landmark_pairs.partner[paired_rows]}
    with drawing(path, 12, 7, legend=4) as figure:
        top, bottom = figure.subplots(2, 1)
        for axes, features, name, rows in (
            (top, trace.reference, names[0], paired["reference"]),
            (bottom, trace.current, names[1], paired["current"]),
        ):
            for k, (start, stop) in enumerate(zip(features.starts, features.stops, strict=True)):
                axes.plot(np.arange(start, stop), features.eta[start:stop], color=segment_colour(k), lw=1.0)
                axes.axvline(start, color=GREY, lw=0.5, zorder=0)
            at = features.landmarks.extents[:, 0]
            axes.plot(at, features.eta[at], "o", mfc="none", mec=DARK, ms=6, label="characteristic point")
            axes.plot(at[rows], features.eta[at[rows]], "o", color=PAIRED, ms=6, label="paired")
            axes.margins(x=0.01)
            axes.axhline(min_curvature, color=PATH, lw=1.0, ls="--", label=f"±U_p = {min_curvature:g} rad")
            axes.axhline(-min_curvature, color=PATH, lw=1.0, ls="--")
            axes.set_title(f"{name}: CF-SMA", parse_math=False)
            axes.set_ylabel("curvature index [rad]")
        bottom.set_xlabel("reading along the sweep (valid readings, counter-clockwise)")


def draw_matched(path: Path, result: MatchResult, scans: tuple[LaserScan, LaserScan], names: tuple[str, str]) -> None:
    """Save the matched points of both scans, the rest in grey, before and after (figures 6 and 9)."""
    reference, before = scans[0].points, scans[1].points
    after = se2.transform(result.pose, before) if result.ok else None
    shown = [reference, before] + ([] if after is None else [after])
    with drawing_places(path, _with_sensor(np.concatenate(shown)), 2, legend=4) as [left, right]:
        draw_overlay(left, result, reference, before)
        as_place(left, "as measured, each scan in its own sensor frame")
        if after is None:
            right.axis("off")
            right.set_title(textwrap.fill(result.outcome.value, 40), y=0.5)
        else:
            draw_overlay(right, result, reference, after)
            as_place(right, f"after the match: {result.n_matched} readings matched")
        matched = ", matched" * result.ok
        left.plot([], [], ".", color=FIRST, label=f"{names[0]}{matched}")
        left.plot([], [], ".", color=SECOND, label=f"{names[1]}{matched}")


def _with_sensor(points: Points) -> Points:
    return np.concatenate([points, np.zeros((1, 2))])


def draw_overlay(axes: Axes, result: MatchResult, points_ref: Points, points_cur: Points) -> None:
    """Draw the points of both scans in one frame: matched ones blue and orange, others grey; all, where none match."""
    took_part = (result.labels_reference == Label.MATCHED, result.labels_current == Label.MATCHED)
    if result.ok:
        axes.plot(*points_ref.T, ".", color=GREY, ms=2.5, label="not matched")
        axes.plot(*points_cur.T, ".", color=GREY, ms=2.5)
    else:  # which scan is which says all that there is
        took_part = (np.full(len(points_ref), True), np.full(len(points_cur), True))
    if isinstance(result.trace, CfSmaTrace):
        # the one method that pairs reading with reading, once
        cur_idx, ref_idx = result.trace.reading_pairs
        beams_ref = result.trace.reference.beam_idx[ref_idx]
        beams_cur = result.trace.current.beam_idx[cur_idx]
        ends = np.stack([points_ref[beams_ref], points_cur[beams_cur]])
        axes.plot(ends[:, :, 0], ends[:, :, 1], color="#e0b000", lw=0.4, zorder=1)
    axes.plot(*points_ref[took_part[0]].T, ".", color=FIRST, ms=4)
    axes.plot(*points_cur[took_part[1]].T, ".", color=SECOND, ms=4)
    axes.plot(0, 0, **_SENSOR, label="sensor, reference")
