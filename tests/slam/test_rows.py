"""Rows: they are those that were appended and kept, in their order."""

from __future__ import annotations

import numpy as np

from curvescan.slam.pose_graph.rows import Rows


def test_rows_are_those_appended_and_kept() -> None:
    rng = np.random.default_rng(0)
    rows, expected = Rows((2,)), np.empty((0, 2))
    for _ in range(5):
        new = rng.standard_normal((30, 2))
        for row in new:
            rows.append(row)
        is_kept = rng.uniform(size=len(rows)) < 0.7
        rows.keep(is_kept)
        expected = np.concatenate((expected, new))[is_kept]
        np.testing.assert_array_equal(rows.array, expected)
        assert len(rows) == len(expected)


def test_fields_of_a_row_are_views() -> None:
    rows = Rows(dtype=np.dtype([("ends", int, 2), ("weight", float)]))
    for k in range(40):
        rows.append(((k, k + 1), 1.0))
    rows.array["weight"][3:5] = 0.0
    assert rows.array["weight"].sum() == 38.0
    assert rows.array["ends"][39].tolist() == [39, 40]
