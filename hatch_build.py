"""Build hook: writes the commit that is built into the sdist and the wheel, for `curvescan --version`.

The commit is that of the tree; that of the sdist, where the wheel is built from one; or what CURVESCAN_COMMIT says, for
builds that see no repository, as that of the container image.
"""

from __future__ import annotations

import os
import runpy
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CommitHook(BuildHookInterface):
    """Adds one file to what is built; none where the commit is not known."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the file into a folder that lasts as long as the build."""
        package = Path(self.root, "src", "curvescan")
        known = runpy.run_path(str(package / "_version.py"))
        commit = os.environ.get("CURVESCAN_COMMIT") or known["commit"]()
        name = known["COMMIT_FILE"]
        if version == "editable" or not commit or (package / name).exists():
            return
        self._folder = tempfile.TemporaryDirectory()
        path = Path(self._folder.name, name)
        path.write_text(commit + "\n", encoding="utf-8")
        inside = f"curvescan/{name}" if self.target_name == "wheel" else f"src/curvescan/{name}"
        build_data["force_include"][str(path)] = inside

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the folder."""
        if hasattr(self, "_folder"):
            self._folder.cleanup()
