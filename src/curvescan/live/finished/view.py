"""view: finished runs on one page, in a notebook or as one HTML file."""

import base64
import hashlib
import html
import json
import os
import re
import tempfile
import zlib
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from curvescan.errors import InvalidArgumentError
from curvescan.io.files.output import output_file
from curvescan.live.finished.results_folder import FinishedRun, read_results

_TYPES = {"<f4": "Float32Array", "<f8": "Float64Array", "|u1": "Uint8Array", "<u2": "Uint16Array", "<i4": "Int32Array"}
_ALIGNED = 8  # each array begins at a multiple of this, as a typed array of JavaScript must


def packed(tree: Any) -> bytes:
    """Return a tree of mappings, sequences, arrays and plain values as a deflated block; NaN only within arrays."""
    blocks: list[bytes] = []
    text = json.dumps(_plain(tree, blocks), separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-(len(text) + 4) % _ALIGNED)
    return zlib.compress(len(text).to_bytes(4, "little") + text + b"".join(blocks), 6)


def _plain(value: Any, blocks: list[bytes]) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(one, blocks) for key, one in value.items()}
    if isinstance(value, bytes):
        return _plain(np.frombuffer(value, np.uint8), blocks)
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        if array.dtype.str not in _TYPES:
            array = array.astype("<f4" if array.dtype.kind == "f" else "<i4")
        at = sum(map(len, blocks))
        data = array.tobytes()
        blocks.append(data + b"\0" * (-len(data) % _ALIGNED))
        return {"array": _TYPES[array.dtype.str], "at": at, "n": array.size}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(one, blocks) for one in value]
    return value


class FinishedView:
    """Finished runs on one page. A notebook shows it; `save` writes one HTML file."""

    def __init__(self, runs: Sequence[FinishedRun]) -> None:
        self.runs = tuple(runs)  # one, or two side by side

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the page into one HTML file, which opens without a server.

        Raises
        ------
        InvalidArgumentError
            When the name does not end in .html.
        OutputError
            When it cannot be written.
        """
        if Path(path).suffix.lower() not in (".html", ".htm"):
            raise InvalidArgumentError(f"a page needs a name that ends in .html, got {os.fspath(path)!r}")
        with output_file(path) as new:
            new.write_text(self._html(), encoding="utf-8", newline="\n")

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{html.escape(self._html())}" style="width: 100%; height: 640px; border: 0"></iframe>'

    def __repr__(self) -> str:
        return f"FinishedView({', '.join(str(run.tree['name']) for run in self.runs)})"

    def _html(self) -> str:
        """Return the page with all that it needs; its policy lets nothing else run or load."""
        page = _file("view.html")
        data = base64.b64encode(packed({"runs": [run.tree for run in self.runs]})).decode()
        css, scripts = _file("page.css"), _file("stage.js") + _file("view.js")
        policy = (
            f"default-src 'none'; script-src '{_hash(scripts)}'; style-src '{_hash(css)}'; img-src blob: data:; "
            "base-uri 'none'; form-action 'none'"
        )
        head = f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n<style>{css}</style>'
        page = re.sub(r'<link rel="icon".*?>\n', "", page)
        page = page.replace('<link rel="stylesheet" href="page.css">', head)
        page = re.sub(r'<script src="stage.js">.*</script>', "", page, flags=re.DOTALL)
        end = f'<script id="data" type="text/plain">{data}</script>\n<script>{scripts}</script>\n</body>'
        return page.replace("</body>", end)


def view(run: Any, other: Any = None) -> FinishedView:
    """Return a page of one finished run, or of two side by side; a notebook shows it, ``save("run.html")`` writes it.

    The page shows map, path, keyframes, every loop closure that was tried and why it was accepted or not, ellipses, and
    the scan at any time.

    Parameters
    ----------
    run : str, path-like or run
        Results folder of `curvescan odometry`, `slam` or `localize`, a map file, or what :func:`curvescan.run`
        returned.
    other : the same or None
        A second run.

    Raises
    ------
    LogFileError, LogFormatError
        When a folder is not one of results, or is damaged.
    """
    return FinishedView([_finished(one) for one in ((run,) if other is None else (run, other))])


def _finished(run: Any) -> FinishedRun:
    if isinstance(run, str | os.PathLike):
        return read_results(Path(run))
    if not callable(getattr(run, "save", None)):
        raise InvalidArgumentError(f"view takes a results folder, a map file or a run, got {type(run).__name__}")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run"
        run.save(path)
        return read_results(path)


def _file(name: str) -> str:
    return files("curvescan.live").joinpath("page", name).read_text("utf-8")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
