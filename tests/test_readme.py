"""What the README shows runs as it stands."""

from __future__ import annotations

import importlib.util
import re

from tests.cli.test_main import flaser
from tests.conftest import ROOT
from tests.scenes import room_scan


def test_the_ten_lines_run(tmp_path, monkeypatch, capsys):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    [code] = re.findall(r"```python\n(.*?)```", readme, flags=re.DOTALL)
    scans = [room_scan((0.02 * k, 0.0, 0.0), sigma=0.003, seed=k) for k in range(3)]
    (tmp_path / "intel.clf").write_text("".join(flaser(s, k) for k, s in enumerate(scans)))
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})  # noqa: S102 - our own README
    printed = capsys.readouterr().out
    assert printed.startswith("True The scans match.")


def test_the_figures_of_a_benchmark_are_written_between_their_marks():
    spec = importlib.util.spec_from_file_location("readme_table", ROOT / "bench/readme_table.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert text.count(module.BEGIN) == text.count(module.END) == 1
    rows = "".join(
        f"| {scenario} | {method} | {success} % | 0.0 % | 0.0 % | 1.{k} mm | 1.12 | 3 | 95 % |\n"
        for k, scenario in enumerate(module.SCENARIOS)
        for method, success in (("curvescan", 99.5), ("cfsma", 30.0), ("idc", 80.0), ("cox", 81.0))
    )
    columns = "scenario method success false without median_error over_the_bound NEES in_95"
    head = " | ".join(word.replace("_", " ") for word in columns.split())
    times = "".join(f"| {m} | 0.1 ms (0.2 ms) | 0.3 ms (1 ms) | 0.2 ms (1 ms) |\n" for m in ("curvescan", "cfsma"))
    found = module.figures(
        "### Time of a scan of 361 beams\n\n| method | prepare a scan | match, no guess | match, good guess |\n"
        f"| --- | --- | --- | --- |\n{times}\n"
        f"### Pairs of scans, 1,000 a scenario, no guess\n\n| {head} |\n| --- |\n{rows}\n### Next\n"
    )
    assert "1,000 pairs of scans a row" in found
    assert "| 0.1 m, 5 deg | 99.5 % | 81.0 % (cox) | 30.0 % | 1.0 mm (1.12 times" in found
    assert "a match of two prepared scans 0.3 ms without a guess, 0.2 ms with a good one" in found
