"""What the README shows runs as it stands."""

from __future__ import annotations

import re

import curvescan as cs
from tests.cli.test_main import flaser
from tests.conftest import ROOT
from tests.scenes import room_scan


def test_the_ten_lines_run(tmp_path, monkeypatch, capsys):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    [code] = re.findall(r"```python\n(.*?)```", readme, flags=re.DOTALL)
    scans = [room_scan((0.02 * k, 0.0, 0.0), sigma=0.003, seed=k) for k in range(3)]
    (tmp_path / "intel.clf").write_text("".join(flaser(s, k) for k, s in enumerate(scans)))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cs.datasets, "fetch", lambda name: tmp_path / f"{name}.clf")
    exec(compile(code, "README.md", "exec"), {})  # noqa: S102 - our own README
    printed = capsys.readouterr().out
    assert printed.startswith("True The scans match.")
