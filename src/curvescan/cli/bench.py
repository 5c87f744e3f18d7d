"""curvescan bench: how fast and how accurate the matchers are, measured here and now."""

from __future__ import annotations


def bench(*, runs: int = 1000, seed: int = 0) -> int:
    """Measure milliseconds a match, and the errors of the paper's experiment 1, on simulated scans.

    Experiment 1: a scan matched with one moved by a random transform (0.1 m and 15 deg, mean). Its two variants:
    the paper's, where both scans are taken from one place and the second is moved on paper; and the robot's,
    where the second is taken from the other place.

    Parameters
    ----------
    runs
        Runs of each variant and world.
    seed
        Seed of all simulated scans; the same seed gives the same errors.
    """
    import numpy as np

    from curvescan.cli.console import OUT, load_kernels, progress_bar, table
    from curvescan.evaluation.random_transform import VARIANTS, run_random_transforms
    from curvescan.evaluation.speed import measure_speed
    from curvescan.matching import MATCHERS

    speeds = table(
        "Time, one thread, 361 beams (median, 99th percentile)", "method", "prepare", "match"
    )
    for method in MATCHERS:
        load_kernels(method)
        speed = measure_speed(method, seed=seed)
        speeds.add_row(
            method, _milliseconds(speed.prepare_seconds), _milliseconds(speed.match_seconds)
        )
    OUT.print(speeds)

    errors = table(
        f"Experiment 1, method cfsma, {runs} runs each (median errors of matches that did not fail)",
        "world",
        "moved",
        "people",
        "translation",
        "rotation",
        "N_t",
        "failed",
        "within 0.1 m, 2 deg",
    )
    for world in ("room", "office", "building"):
        for moves, people_share in VARIANTS:
            with progress_bar(f"{world}, {moves} moved", runs, "runs") as advance:
                result = run_random_transforms(
                    moves=moves,
                    n_runs=runs,
                    world=world,
                    people_share=people_share,
                    seed=seed,
                    on_run=advance,
                )
            errors.add_row(
                world,
                f"the {moves}",
                f"{100 * people_share:.0f} %",
                f"{1e3 * np.nanmedian(result.translation_error):.1f} mm",
                f"{np.degrees(np.nanmedian(result.rotation_error)):.2f} deg",
                f"{np.median(result.n_matched[result.n_matched > 0]):.0f}",
                f"{100 * result.failed_share:.1f} %",
                f"{100 * result.right_share:.1f} %",
            )
    OUT.print(errors)
    return 0


def _milliseconds(seconds: object) -> str:
    import numpy as np

    median, p99 = 1e3 * np.percentile(np.asarray(seconds), [50, 99])
    return f"{median:.3f} ms, {p99:.3f} ms"
