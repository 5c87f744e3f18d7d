"""curvescan info: what is in a log, and what is wrong with it; curvescan convert: a log in another format."""

from __future__ import annotations

import json as json_format
import math
import sys
import textwrap
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import numpy as np
import tyro

from curvescan.cli.console import ERR, OUT, progress_bar, table, with_flags, with_options
from curvescan.cli.options import (
    Flag,
    LogPath,
    MatcherFlags,
    Matching,
    OutFolder,
    Reading,
    ReadingFlags,
    results_folder,
)
from curvescan.errors import InvalidArgumentError
from curvescan.io import output_folder, pick_scans, write_log

if TYPE_CHECKING:
    from curvescan.diagnostics.inspect import LogReport
    from curvescan.diagnostics.issues import Issue

_INDENT, _LEAST_WIDTH = 19, 30  # columns of names, and of text at least


def info(
    log: LogPath,
    /,
    *,
    json: Flag = False,
    reading: ReadingFlags = Reading(),  # noqa: B008 - frozen
) -> int:
    """Tell what is in a log and what is wrong with it: each issue, its consequence and the option that mends it.

    Exit status 0 when motion can be looked for in the log (two scans with a valid reading), 1 when not.

    Parameters
    ----------
    json
        Print JSON: `usable` (bool), `issues` (a list of topic, kind, what, consequence, remedy, mending) and `report`
        (all figures; null where one is not known or has no limit). The keys are the same for every log.
    """
    from curvescan.diagnostics.inspect import inspect_log
    from curvescan.diagnostics.issues import find_issues, report_as_plain
    from curvescan.engines.rig import RigLog
    from curvescan.io.log import HeldLog

    opened = reading.open(log)
    lasers = opened.lasers if isinstance(opened, RigLog) else {}
    report = inspect_log(HeldLog(opened))
    mounts, wrong = _mounts_of(log) if lasers or reading.topic is not None else ("", [])
    issues = [*find_issues(report), *wrong]
    told = {issue.kind for issue in issues}
    for name, laser in lasers.items():  # the joined scans do not show all that is wrong with one of them
        further = (issue for issue in find_issues(inspect_log(HeldLog(laser))) if issue.kind not in told)
        issues += [replace(issue, what=f"{name}: {issue.what}") for issue in further]
    if json:
        print(json_format.dumps(report_as_plain(report, issues), indent=2, allow_nan=False))
        return 0 if report.is_usable else 1
    OUT.print(report.name, style="bold")
    for name, value in [*_rows(report), ("mounts", mounts)]:
        if value:
            _show(name, value)
    for issue in issues:
        _show(issue.topic, with_flags(issue.sentence), style="yellow")
    if not issues:
        OUT.print("  nothing wrong found")
    if not report.is_usable:
        OUT.print("  not usable: motion takes two scans with a valid reading")
        return 1
    given = [word for word in sys.argv[1:] if word not in ("info", "--json")]
    proposed = [] if lasers else [i for i in issues if not i.mending]  # what is mended needs no option
    OUT.print(f"to map it: {with_options(['curvescan', 'slam', *given], proposed)}")
    return 0


def _mounts_of(path: Path) -> tuple[str, list[Issue]]:
    """Return what the scans say of where the lasers of a bag are to each other, and which mounts they contradict."""
    from curvescan.evaluation.mounts import check_mounts

    try:
        checks = check_mounts(path, uses_wheels=False)
    except InvalidArgumentError as error:
        return f"not checked: {error}", []
    wrong = [check.issue() for check in checks if check.is_wrong]
    right = [check.topic for check in checks if check.given is not None and not check.is_wrong]
    return f"of {', '.join(right)}: the scans agree with the transforms" if right else "", wrong


def _show(name: str, value: str, *, style: str = "") -> None:
    """Print a row, its text wrapped to the terminal beside its name."""
    lines = textwrap.wrap(value, max(OUT.width - _INDENT, _LEAST_WIDTH), break_on_hyphens=False) or [""]
    for k, line in enumerate(lines):
        OUT.print(f"  {name if k == 0 else '':<{_INDENT - 3}}", end=" ", style=style)
        OUT.print(line)


def _rows(report: LogReport) -> list[tuple[str, str]]:
    time = report.time
    rate = "" if math.isnan(time.mean_rate) else f"{time.mean_rate:.2f} Hz over "
    blind = f"; {report.n_blind_beams} never give a reading" if report.n_blind_beams else ""
    return [
        ("format", report.format),
        ("messages", ", ".join(f"{count:,} {tag}" for tag, count in report.tag_counts.items())),
        ("scans", f"{report.n_scans:,} ({rate}{time.duration:,.1f} s)"),
        ("time steps", _steps(report)),
        ("beams", ", ".join(f"{n} ({count:,} scans)" for n, count in report.beam_counts.items()) + blind),
        (
            "field of view",
            f"{report.fov_deg:.2f} deg from {report.first_beam_deg + 0.0:.2f} deg "  # no -0.00
            f"in steps of {report.angle_step_deg:.4g} deg",
        ),
        ("valid range", f"{report.range_min:g} to {report.range_max:g} m"),
        ("valid readings", f"{100 * report.valid_share:.1f} %, the farthest {report.largest_reading:g} m"),
        ("range noise", _noise(report)),
        ("no-return codes", ", ".join(f"{c.value:g} ({100 * c.share:.1f} %)" for c in report.codes) or "none"),
        (
            "wheel odometry",
            "none"
            if report.odometry is None
            else f"{report.odometry.path_length:,.1f} m, turned {report.odometry.turned_deg:,.0f} deg",
        ),
        ("mount", _mount(report)),
        ("beam order", _beam_order(report)),
        ("turns", _turns(report)),
    ]


def _noise(report: LogReport) -> str:
    if math.isinf(report.noise_doubled_at):
        return ""
    return f"grows with the range: twice the variance at {report.noise_doubled_at:.2g} m"


def _steps(report: LogReport) -> str:
    time = report.time
    if math.isnan(time.step_median):
        return ""
    steps = f"{time.step_median:.4g} s, jitter {1e3 * time.jitter:,.1f} ms"
    if report.sweep_seconds > 0.0:
        steps += f"; a sweep takes {report.sweep_seconds:.3g} s by the times of its beams"
    return steps


def _mount(report: LogReport) -> str:
    hangs = "upside down" if report.is_upside_down else ""
    if report.mount is None:
        return hangs
    x, y = (round(value, 3) + 0.0 for value in report.mount[:2])  # no -0.000
    yaw = round(math.degrees(report.mount[2]), 1) + 0.0
    at = f"x {x:.3f} m, y {y:.3f} m, yaw {yaw:.1f} deg on the robot"
    return f"{at}, {hangs}" if hangs else at


def _beam_order(report: LogReport) -> str:
    order = report.beam_order
    if order is None or not order.n_pairs:
        return ""
    if not (order.is_forwards or order.is_reversed_order):
        return "the scans do not show in which order their beams were swept"
    return "reverse of the listed one" if order.is_reversed_order else "as listed"


def _turns(report: LogReport) -> str:
    sense = report.sense
    if sense is None:
        return ""
    if not (sense.is_along or sense.is_reversed):
        return f"the scans do not tell whether they turn with the {sense.reference}"
    way = "against" if sense.is_reversed else "with"
    count = sense.n_reversed if sense.is_reversed else sense.n_turns - sense.n_reversed
    return f"{way} the {sense.reference} in {count} of {sense.n_turns} sharp turns"


FormatName: TypeAlias = Literal["carmen", "csv", "npz", "ros1", "ros2", "mcap"]
"""Names of the table of writers, written out so that --help loads none of them."""


def convert(
    log: LogPath,
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT")],
    /,
    *,
    format: FormatName | None = None,  # noqa: A002 - the flag's name
    reading: ReadingFlags = Reading(),  # noqa: B008 - frozen
) -> int:
    """Write the scans and the odometry of a log in another format, and tell what that format cannot keep.

    The ending of OUT chooses: .clf .log (CARMEN), .csv, .npz, .bag (ROS 1), .mcap, or none for the folder of a ROS 2
    bag (sqlite3); .csv.gz and .clf.gz are compressed.

    Parameters
    ----------
    out
        The file to write, or for ros2 the folder; an old file is replaced when all is written.
    format
        The format, in place of what the ending of OUT says.
    """
    source = reading.open(log)
    with progress_bar("convert", len(source)) as advance:
        losses = write_log(out, source, format=format, source=log, on_scan=advance)
    for read_error in source.read_errors:
        ERR.print(f"not read: {read_error}")
    for loss in losses:
        ERR.print(f"not kept: {loss}")
    OUT.print(f"wrote {out}: {len(source):,} scans of {source.name}")
    return 0


def match(
    log: LogPath,
    i: Annotated[tyro.conf.Positional[int], tyro.conf.arg(metavar="I")],
    j: Annotated[tyro.conf.Positional[int], tyro.conf.arg(metavar="J")],
    /,
    *,
    out: OutFolder = None,
    matching: Matching = MatcherFlags(),  # noqa: B008 - frozen
    reading: ReadingFlags = Reading(),  # noqa: B008 - frozen
) -> int:
    """Print the pose of scan J seen from scan I, and draw how it came about.

    Exit status 3 where the scans do not match.

    Writes segments.png (the paper's figure 4), curvature.png (5), matched.png (6 and 9) and match.json. Segments and
    curvature functions are those of CF-SMA, whatever method found the pose.

    Parameters
    ----------
    i
        Number of the reference scan, from 0.
    j
        Number of the current scan, from 0.
    """
    from curvescan import match as match_scans
    from curvescan.plots.match import save_match

    source, out = reading.open(log), results_folder(out, log, "match")
    reference, current = pick_scans(source, (i, j))
    with output_folder(out) as folder:
        result = match_scans(reference, current, method=matching.method, config=matching.matcher)
        names = (f"scan {i}", f"scan {j}")
        record = save_match(folder, result, scans=(reference, current), names=names, cfsma=matching.cfsma)
    said = f"{source.name}: scan {j} seen from scan {i}: {result.outcome.value}"
    if result.ok:
        OUT.print(said)
        x, y, theta = result.pose
        sigma = np.sqrt(np.diag(result.covariance))
        OUT.print(
            f"  x {x:.4f} ± {sigma[0]:.4f} m, y {y:.4f} ± {sigma[1]:.4f} m, theta {np.degrees(theta):.3f} ± "
            f"{np.degrees(sigma[2]):.3f} deg, {result.n_matched} matched pairs"
        )
    if result.degenerate_direction is not None:
        dx, dy, dtheta = result.degenerate_direction
        OUT.print(f"  not fixed along x {dx:+.2f} m, y {dy:+.2f} m, theta {dtheta:+.2f} rad")
    if "readings_reference" in record:
        _show_gates(record["readings_reference"], record["readings_current"], names)
    OUT.print(f"wrote {out}/segments.png, curvature.png, matched.png, match.json")
    if not result.ok:
        OUT.print(f"{said[:-1]}; what helps: scans that share more, or `curvescan odometry`, which knows the motion")
    return 0 if result.ok else 3


def _show_gates(in_reference: Mapping[str, int], in_current: Mapping[str, int], names: tuple[str, str]) -> None:
    from curvescan.matchers.cfsma.trace import Gate

    gates = table("What became of the readings", "", *names, "decided by")
    for gate in Gate:
        name = gate.name.lower()
        gates.add_row(gate.sentence, f"{in_reference[name]}", f"{in_current[name]}", gate.parameter)
    OUT.print(gates)
