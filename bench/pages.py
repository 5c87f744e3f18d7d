"""Pages of finished runs in a headless Chromium: time to the first picture, frame times, and pictures at three widths.

``python bench/pages.py FOLDER PAGE.html...`` opens each page (`curvescan view RESULTS --export PAGE.html`, or an
address), dark and light. A frame is the time of one drawing of the page, the GPU left out: zoomed in and followed,
played from the first scan to the last, and dragged.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tests.live.chromium import Page, chromium

WIDTHS = ((1440, 900), (820, 1180), (390, 844))
"""A desktop, a tablet and a phone."""

READY = "document.body && document.body.dataset.ready === 'yes'"

FRAMES = """(async () => {
  const took = [], gaps = [], n = runs[0].stamps.length;
  %s
  let before = performance.now();
  for (let f = 0; f < 120; f++) {
    const started = performance.now();
    goTo(Math.round((f / 119) * (n - 1))); %s; draw();
    took.push(performance.now() - started);
    await new Promise(requestAnimationFrame);
    gaps.push(performance.now() - before); before = performance.now();
  }
  return [took, gaps];
})()"""

VIEWS = {
    "whole map": ("choose(true, false)", ""),
    "following": ("choose(false, true); view.scale = 60", ""),
    "dragged": ("choose(false, false); view.scale = 20", "view.x += 0.3; view.y += 0.1"),
    "all layers": (
        "for (const b of document.querySelectorAll('#panel input[type=checkbox]')) if (!b.checked) b.click(); "
        "choose(true, false)",
        "",
    ),
}
"""What is done before, and at each frame."""


def address(given: str) -> str:
    """Return the address of a page or of a file."""
    return given if "://" in given else Path(given).resolve().as_uri()


def first_picture(page: Page, url: str) -> float:
    """Return seconds from the call of a page to its first whole picture."""
    started = time.monotonic()
    page.open(url, *WIDTHS[0])
    while not page.run(READY):
        time.sleep(0.005)
    page.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return time.monotonic() - started


def frames(page: Page) -> list[str]:
    """Return a line a view: milliseconds of script a frame, and from frame to frame."""
    lines = []
    for name, (before, each) in VIEWS.items():
        took, gaps = (np.array(values) for values in page.run(FRAMES % (before, each)))
        lines.append(
            f"  {name}: {np.median(took):.1f} ms a frame, {np.percentile(took, 99):.1f} ms at 99 %; "
            f"from frame to frame {np.median(gaps):.1f} ms, {np.percentile(gaps, 99):.1f} ms at 99 %"
        )
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Print times, and save pictures."""
    parser = argparse.ArgumentParser(prog="python bench/pages.py")
    parser.add_argument("folder", type=Path, help="where pictures go")
    parser.add_argument("pages", nargs="+")
    given = parser.parse_args(arguments)
    given.folder.mkdir(parents=True, exist_ok=True)
    for one in given.pages:
        name, url = Path(one).stem, address(one)
        with chromium() as page:
            times = [first_picture(page, url) for _ in range(3)]
            size = f", {Path(one).stat().st_size / 1e6:.1f} MB" if Path(one).is_file() else ""
            print(f"{name}{size}: first picture after {', '.join(f'{t:.2f}' for t in times)} s")
            for line in frames(page):
                print(line)
            for width, height in WIDTHS:
                for is_dark in (False, True):
                    page.open(url, width, height, is_dark=is_dark)
                    page.wait(READY)
                    page.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
                    page.picture(str(given.folder / f"{name}-{width}-{'dark' if is_dark else 'light'}.png"))
            print(f"  errors on the page: {page.log or 'none'}")


if __name__ == "__main__":
    main()
