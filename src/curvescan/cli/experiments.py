"""curvescan experiments: the paper's experiments and tables, beside the paper's own figures."""

from __future__ import annotations

from pathlib import Path


def experiments(
    *, out: Path, logs: tuple[Path, ...] = (), quick: bool = False, seed: int = 0
) -> int:
    """Run the paper's five experiments with every method, and report them beside the paper's figures.

    Writes report.html (self-contained), report.md, results.json and the figures. The same seed gives the same numbers to
    the last digit, times aside.

    Parameters
    ----------
    out
        Folder for the report; made if it is missing.
    logs
        Real logs on which every method is run too.
    quick
        A tenth of the runs and a quarter of the scans, to see that all works.
    seed
        Seed of all simulated scans.
    """
    from curvescan.cli.console import ERR, OUT, load_usable_methods, progress_bars
    from curvescan.evaluation.experiments import run_experiments
    from curvescan.io import output_folder, read_log
    from curvescan.view.experiments import save_experiments

    sources = [read_log(path) for path in logs]
    with output_folder(out) as folder:
        methods = load_usable_methods()
        with progress_bars() as progress:
            results = run_experiments(
                methods=methods, logs=sources, is_quick=quick, seed=seed, progress=progress
            )
        with ERR.status("drawing and writing the report"):
            save_experiments(folder, results)
    OUT.print(f"wrote {out}/report.html, report.md, results.json", markup=False)
    return 0
