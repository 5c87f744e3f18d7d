"""The bench of reading: every format that is read, with the log that was written."""

from __future__ import annotations

from curvescan.io.reading import FORMATS
from reading_speed import N_FORMATS, measure_reading, reading_table


def test_every_format_is_measured() -> None:
    n_calls = 0

    def count() -> None:
        nonlocal n_calls
        n_calls += 1

    speeds = measure_reading(n_scans=5, repeats=1, on_format=count)
    assert n_calls == N_FORMATS == len(speeds)
    assert {speed.format for speed in speeds} == {row.name for row in FORMATS}
    for speed in speeds:
        assert (speed.n_scans, speed.n_beams) == (5, 682)
        assert speed.open_seconds > 0.0
        assert speed.scans_per_second > 0.0
        assert 682 < speed.bytes_per_scan < 40 * 682
    rows = reading_table(speeds).rows
    assert [row[0] for row in rows] == [speed.format for speed in speeds]
