"""Build hook: what is built knows its commit, and a wheel may bring machine code.

The commit is that of the tree; that of the sdist, where the wheel is built from one; or what CURVESCAN_COMMIT says, for
builds that see no repository, as that of the container image. The machine code is what `curvescan warm-up --cache` wrote
into the folder that CURVESCAN_KERNELS names; a wheel with it serves all other machines as one without.
"""

from __future__ import annotations

import os
import runpy
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class ReleaseHook(BuildHookInterface):
    """Adds files to what is built."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the commit into a folder that lasts as long as the build, and name the machine code."""
        if version == "editable":
            return
        package = Path(self.root, "src", "curvescan")
        known = runpy.run_path(str(package / "_version.py"))
        commit = os.environ.get("CURVESCAN_COMMIT") or known["commit"]()
        name, included = known["COMMIT_FILE"], build_data["force_include"]
        if commit and not (package / name).exists():
            self._folder = tempfile.TemporaryDirectory()
            path = Path(self._folder.name, name)
            path.write_text(commit + "\n", encoding="utf-8")
            included[str(path)] = f"curvescan/{name}" if self.target_name == "wheel" else f"src/curvescan/{name}"
        kernels = os.environ.get("CURVESCAN_KERNELS")
        if kernels and self.target_name == "wheel":
            included[str(Path(kernels).absolute())] = "curvescan/_kernels"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the folder."""
        if hasattr(self, "_folder"):
            self._folder.cleanup()
