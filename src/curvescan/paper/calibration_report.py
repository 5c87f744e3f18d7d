"""Calibration as tables and figures."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.paper.calibration import CURVATURES, SIGMAS, TOLERANCES, Calibration
from curvescan.paper.calibration_pairs import NEIGHBOURS, SIMILARITIES
from curvescan.plots.colours import DARK, PATH, segment_colour
from curvescan.plots.map import drawing
from curvescan.runs.document import ResultTable


def draw_calibration(path: Path, calibration: Calibration) -> None:
    """Save false peaks against U_k, residual correlations with U_c, and corners found against U_p."""
    config = calibration.config
    with drawing(path, 13.0, 4.3) as figure:
        left, middle, right = figure.subplots(1, 3)
        for k, (group, peaks) in enumerate(zip(calibration.groups, calibration.false_peaks, strict=True)):
            left.plot(TOLERANCES, peaks, ".-", color=segment_colour(k), label=group.name)
        left.set_yscale("symlog", linthresh=0.1)
        left.set(xlabel="U_k [m]", ylabel="false peaks a plane", ylim=(0, None))
        left.axvline(config.curvature.arc_tolerance, color=PATH, ls="--", lw=1.0)
        left.set_title(f"U_k = {config.curvature.arc_tolerance:g} m")
        left.legend(title="planes")

        residual = calibration.residual_correlations
        if residual.size:
            share = np.arange(1, residual.size + 1) / residual.size
            middle.plot(residual, 100.0 * share, color=DARK)
        middle.axvline(config.functions.min_correlation, color=PATH, ls="--", lw=1.0)
        middle.set(xlabel="correlation of two planes' functions", ylabel="pairs below [%]")
        middle.set_title(f"U_c = {config.functions.min_correlation:g}")

        right.plot(CURVATURES, 100.0 * calibration.detection, ".-", color=DARK, label="corners found")
        right.plot(CURVATURES, 100.0 * calibration.false_alarms, ".-", color=PATH, label="planes with a peak")
        right.axvline(config.landmarks.min_curvature, color=PATH, ls="--", lw=1.0)
        right.set(xlabel="U_p [rad]", ylabel="share [%]")
        right.set_title(f"U_p = {config.landmarks.min_curvature:g} rad")
        right.legend()


def calibration_tables(calibration: Calibration) -> list[ResultTable]:
    """Return what was found beside the defaults and the paper's values, and the figures it was chosen by."""
    pairs = calibration.pairs
    return [
        _parameter_table(calibration),
        ResultTable(
            title="A wall 0.9 m beside the sensor, out to 8 m",
            columns=("sigma_rho [m]", "scans in which it is one segment"),
            rows=[(f"{s:g}", f"{100 * share:.0f} %") for s, share in zip(SIGMAS, calibration.whole, strict=True)],
        ),
        ResultTable(
            title="False peaks a plane",
            columns=("U_k [m]", *(group.name for group in calibration.groups)),
            rows=[
                (f"{u_k:g}", *(f"{peaks:.2f}" for peaks in column))
                for u_k, column in zip(TOLERANCES, calibration.false_peaks.T, strict=True)
            ],
        ),
        ResultTable(
            title="n: consecutive scans of simulated offices, up to 0.1 m and 5 deg apart",
            columns=("n", "right within 0.1 m, 2 deg", "time of a match"),
            rows=[
                (f"{n}", f"{100 * share:.1f} %", f"{1e3 * seconds:.2f} ms")
                for n, share, seconds in zip(NEIGHBOURS, pairs.right_shares, pairs.seconds, strict=True)
            ],
        ),
        ResultTable(
            title="S_min: pairs of characteristic points of the same scans",
            columns=("S_min", "wrong pairs rejected", "right pairs kept"),
            rows=[
                (f"{s_min:.2f}", f"{100 * rejected:.1f} %", f"{100 * kept:.1f} %")
                for s_min, rejected, kept in zip(SIMILARITIES, pairs.wrong_rejected, pairs.right_kept, strict=True)
            ],
        ),
    ]


def _parameter_table(calibration: Calibration) -> ResultTable:
    rows: tuple[tuple[str, Callable[[CfSmaConfig], float], str, str], ...] = (
        ("sigma_rho, eq. 2", lambda c: c.segmentation.range_sigma, " m", "lost"),
        ("U_k, arc minus chord", lambda c: c.curvature.arc_tolerance, " m", "1.0, unit unknown"),
        ("U_c, correlation of functions", lambda c: c.functions.min_correlation, "", "0.4"),
        ("U_p, curvature of a corner", lambda c: c.landmarks.min_curvature, " rad", "0.2 rad"),
        ("n, neighbours", lambda c: c.landmarks.n_neighbours, "", "30"),
        ("S_min, Pearson similarity", lambda c: c.landmarks.min_similarity, "", "0.2"),
    )
    found, default = calibration.config, CfSmaConfig()
    return ResultTable(
        title="Parameters found",
        columns=("parameter", "found", "default", "paper"),
        rows=[
            ("range noise of the planes", f"{calibration.noise:.4f} m", "-", "-"),
            *((name, f"{of(found):g}{unit}", f"{of(default):g}{unit}", paper) for name, of, unit, paper in rows),
        ],
    )
