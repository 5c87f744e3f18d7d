"""curvescan match: two scans of a log, their pose, and pictures of how it came about."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import tyro

from curvescan.cli.options import LogPath, MatcherFlags, Matching, OutFolder, Reading, ReadingFlags, results_folder

if TYPE_CHECKING:
    from curvescan.matchers.cfsma.trace import CfSmaTrace


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
    import numpy as np

    from curvescan import match as match_scans
    from curvescan.cli.console import OUT
    from curvescan.io import output_folder, pick_scans
    from curvescan.matchers.cfsma.trace import CfSmaTrace
    from curvescan.plots.match import save_match

    source, out = reading.open(log), results_folder(out, log, "match")
    reference, current = pick_scans(source, (i, j))
    with output_folder(out) as folder:
        result = match_scans(reference, current, method=matching.method, config=matching.matcher)
        save_match(folder, result, scans=(reference, current), names=(f"scan {i}", f"scan {j}"), cfsma=matching.cfsma)
    OUT.print(f"{source.name}: scan {j} seen from scan {i}: {result.outcome.value}")
    if result.ok:
        x, y, theta = result.pose
        sigma = np.sqrt(np.diag(result.covariance))
        OUT.print(
            f"  x {x:.4f} ± {sigma[0]:.4f} m, y {y:.4f} ± {sigma[1]:.4f} m, theta {np.degrees(theta):.3f} ± "
            f"{np.degrees(sigma[2]):.3f} deg, {result.n_matched} matched pairs"
        )
    if result.degenerate_direction is not None:
        dx, dy, dtheta = result.degenerate_direction
        OUT.print(f"  not fixed along x {dx:+.2f} m, y {dy:+.2f} m, theta {dtheta:+.2f} rad")
    if isinstance(result.trace, CfSmaTrace):
        _show_gates(result.trace, i, j)
    OUT.print(f"wrote {out}/segments.png, curvature.png, matched.png, match.json")
    return 0 if result.ok else 3


def _show_gates(trace: CfSmaTrace, i: int, j: int) -> None:
    from curvescan.cli.console import OUT, table
    from curvescan.matchers.cfsma.trace import Gate, count_gates

    gates = table("What became of the readings", "", f"scan {i}", f"scan {j}", "decided by")
    in_reference = count_gates(trace.gates_reference)
    in_current = count_gates(trace.gates_current)
    for gate in Gate:
        name = gate.name.lower()
        gates.add_row(gate.sentence, f"{in_reference[name]}", f"{in_current[name]}", gate.parameter)
    OUT.print(gates)
