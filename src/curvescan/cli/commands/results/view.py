"""curvescan view: finished runs on a page in the browser, or as one HTML file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro


def view(
    results: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RESULTS")],
    other: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="OTHER")] = None,
    /,
    *,
    export: Annotated[Path | None, tyro.conf.arg(metavar="FILE.html")] = None,
    host: str = "127.0.0.1",
    http_port: int | None = None,
) -> int:
    """Look at a finished run, or at two side by side: map, path, scans, and why each loop closure was accepted or not.

    The page is served until Ctrl-C. With --export it is written into one HTML file, which opens without a server.

    Parameters
    ----------
    results
        Results folder of `curvescan odometry`, `slam` or `localize`, or a map file (.csmap).
    other
        A second one, shown beside it.
    export
        Write the page into this file instead.
    host
        Address that the page is served at; 0.0.0.0 lets other machines look on.
    http_port
        Port of the page; 8765, or a free one if that is in use.
    """
    from curvescan.cli.console import ERR, OUT
    from curvescan.cli.serving import free_port, open_browser, wait
    from curvescan.live.finished.site import FinishedSite
    from curvescan.live.finished.view import view as view_runs
    from curvescan.live.server import PageServer

    page = view_runs(results, other)
    if export is not None:
        page.save(export)
        OUT.print(f"wrote {export}: {export.stat().st_size / 1e6:.1f} MB")
        return 0
    with PageServer(FinishedSite(page), host=host, port=free_port(host, http_port)) as server:
        ERR.print(f"the page is at {server.url}")
        open_browser(server.url)
        wait("Ctrl-C closes the page")
    return 0
