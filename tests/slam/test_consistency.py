"""Pairwise consistency: the largest set in which all agree."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from curvescan.slam.pose_graph.consistency import largest_clique


@pytest.mark.parametrize("seed", range(8))
def test_it_is_as_large_as_the_one_found_by_trying_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    links = rng.random((9, 9)) < 0.5
    links = links | links.T

    def is_clique(rows: tuple[int, ...]) -> bool:
        return all(links[a, b] for a, b in itertools.combinations(rows, 2))

    sizes = [size for size in range(10) if any(map(is_clique, itertools.combinations(range(9), size)))]
    found = largest_clique(links)
    assert is_clique(tuple(found))
    assert len(found) == max(sizes)


def test_of_no_rows_it_is_empty() -> None:
    assert len(largest_clique(np.zeros((0, 0), dtype=np.bool_))) == 0
