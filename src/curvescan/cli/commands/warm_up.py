"""curvescan warm-up: compile now what the first run would wait for, for this machine or for another."""

from __future__ import annotations

from pathlib import Path
from typing import Literal


def warm_up(*, cache: Path | None = None, processor: Literal["generic", "native"] = "generic") -> int:
    """Compile the kernels of matching, odometry, SLAM and maps, so that no later run waits for a compiler.

    Parameters
    ----------
    cache
        Folder for code that travels, for an image or a package; a run finds it in NUMBA_CACHE_DIR. What does not fit
        the Python, the Numba or the kind of processor there is passed over in silence. Left out: the cache of this
        machine.
    processor
        For which processor that folder is: any of the kind of this one (6 % slower, the same results), or this one
        alone.
    """
    import curvescan
    from curvescan.cli.console import OUT

    seconds = curvescan.warm_up(cache=cache, processor=processor)
    OUT.print(f"compiled or loaded in {seconds:.1f} s" + (f": {cache}" if cache else ""))
    return 0
