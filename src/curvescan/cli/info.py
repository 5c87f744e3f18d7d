"""curvescan info: what is in a log, and what is wrong with it."""

from __future__ import annotations

import math

from curvescan.cli.options import Laser, LaserSetUp, LogPath, Topic, open_log


def info(
    log: LogPath,
    /,
    *,
    range_max: float | None = None,
    topic: Topic = None,
    laser: LaserSetUp = Laser(),  # noqa: B008 - frozen
) -> int:
    """Tell what is in a log and what is wrong with it, each finding with its consequence.

    Exit status 0 when motion can be looked for in it, 1 when not.

    Parameters
    ----------
    log
        The log: CARMEN, a ROS bag (ROS 1, ROS 2 sqlite3 or MCAP), CSV, NPZ or CoreSLAM, plain or gzip-compressed; or a
        ROS 2 bag's folder.
    range_max
        Upper limit of a valid reading, metres, in place of what the log says.
    topic
        Which topic of a ROS bag to read, where it holds laser scans on several.
    laser
        How the laser is set up, where its log does not say so or is wrong.
    """
    from rich.markup import escape

    from curvescan.cli.console import OUT
    from curvescan.io import findings_of, inspect_log

    report = inspect_log(open_log(log, range_max=range_max, topic=topic, laser=laser))
    time = report.time
    rows = [
        ("format", report.format),
        ("messages", ", ".join(f"{count:,} {tag}" for tag, count in report.tag_counts.items())),
        ("scans", f"{report.n_scans:,} ({_rate(time.mean_rate)}{time.duration:,.1f} s)"),
        ("beams", ", ".join(f"{n} ({count:,} scans)" for n, count in report.beam_counts.items())),
        (
            "field of view",
            f"{report.fov_deg:.2f} deg from {report.first_beam_deg:.2f} deg "
            f"in steps of {report.angle_step_deg:.4g} deg",
        ),
        ("valid range", f"{report.range_min:g} to {report.range_max:g} m"),
        (
            "valid readings",
            f"{100 * report.valid_share:.1f} %, the farthest {report.largest_reading:g} m",
        ),
        (
            "no-return codes",
            ", ".join(f"{c.value:g} ({100 * c.share:.1f} %)" for c in report.codes) or "none",
        ),
        (
            "wheel odometry",
            "none"
            if report.odometry is None
            else f"{report.odometry.path_length:,.1f} m, turned {report.odometry.turned_deg:,.0f} deg",
        ),
    ]
    # names and tags come from the file: a bracket in them is a bracket, not markup
    OUT.print(f"[bold]{escape(report.name)}[/bold]")
    for name, value in rows:
        if value:
            OUT.print(f"  {name:<16} {escape(value)}")
    findings = findings_of(report)
    for finding in findings:
        OUT.print(f"  [yellow]{finding.topic:<16}[/yellow] {escape(finding.sentence)}")
    if not findings:
        OUT.print("  nothing wrong found")
    return 0 if report.is_usable else 1


def _rate(hertz: float) -> str:
    return "" if math.isnan(hertz) else f"{hertz:.2f} Hz over "
