"""Write the figures of bench/bench.md into README.md, between its two marks: `python bench/readme_table.py`."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
README, BENCH = ROOT / "README.md", ROOT / "bench" / "bench.md"
BEGIN, END = ("<!-- figures of bench/bench.md, written by bench/readme_table.py -->", "<!-- end of the figures -->")

DEFAULT, PAPER = "curvescan", "cfsma"
SCENARIOS = {
    "small": "0.1 m, 5 deg",
    "large": "0.6 m, 40 deg",
    "large, people": "0.6 m, 40 deg, 15 % of the beams on people",
    "360 deg, any turn": "0.3 m, any turn, 360-degree sensor",
}
"""Rows of the table: what a scenario of the benchmark is called in README."""

Row = dict[str, str]


def table(text: str, title: str) -> list[Row]:
    """Return the rows of the table whose heading begins with a title, by the names of its columns."""
    _, _, rest = text.partition(f"### {title}")
    lines = [line for line in rest.split("\n### ")[0].splitlines() if line.startswith("|")]
    names, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [dict(zip(names, row, strict=True)) for row in rows]


def figures(text: str) -> str:
    """Return what README says of a benchmark."""
    n_pairs = re.search(r"### Pairs of scans, ([\d,]+) a scenario", text)
    assert n_pairs is not None, "bench.md has no table of scenarios"
    scores = table(text, "Pairs of scans")
    lines = [
        f"Simulated offices, 361 beams over 180 degrees, 8 m, 10 mm of noise, {n_pairs[1]} pairs of scans a row, no "
        f"guess.",
        "Success: within 0.1 m and 2 deg.",
        "",
        "| two scans apart by up to | default matcher | best of the others | `cfsma` | median error of the default |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for scenario, words in SCENARIOS.items():
        by_method = {row["method"]: row for row in scores if row["scenario"] == scenario}
        ours, paper = by_method.pop(DEFAULT), by_method.pop(PAPER)
        best = max(by_method, key=lambda name: float(by_method[name]["success"].split()[0]))
        lines.append(
            f"| {words} | {ours['success']} | {by_method[best]['success']} ({best}) | {paper['success']} "
            f"| {ours['median error']} ({ours['over the bound']} times the Cramér-Rao bound) |"
        )
    times = {row["method"]: row for row in table(text, "Time of a scan")}
    ours, paper = times[DEFAULT], times[PAPER]
    lines += [
        "",
        f"- **Time**, medians, one thread: a match of two prepared scans {_median(ours, 'match, no guess')} without "
        f"a guess, "
        f"{_median(ours, 'match, good guess')} with a good one; preparing a scan",
        f"  {_median(ours, 'prepare a scan')}. `cfsma`: {_median(paper, 'match, no guess')}, and "
        f"{_median(paper, 'prepare a scan')} to prepare.",
    ]
    return "\n".join(lines)


def _median(row: Row, column: str) -> str:
    return row[column].partition(" (")[0]


def main() -> None:
    """Replace what stands between the marks."""
    text = README.read_text(encoding="utf-8")
    before, mark, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (mark and end):
        raise SystemExit(f"README.md must have the marks {BEGIN!r} and {END!r}")
    new = figures(BENCH.read_text(encoding="utf-8"))
    README.write_text(f"{before}{BEGIN}\n{new}\n{END}{after}", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
