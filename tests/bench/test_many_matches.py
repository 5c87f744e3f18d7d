"""The bench of times: many matches, by how they are called."""

from __future__ import annotations

from many_matches import many_table, measure_many


def test_many_matches_are_timed_one_by_one_in_one_call_and_on_two_processes():
    seconds = measure_many(30, n_pairs=10)
    assert list(seconds) == ["match, one by one", "match_many", "match_many, two processes"]
    # a match is no shorter than a microsecond, and on the slowest machine no longer than a second
    assert all(1e-6 < one < 1.0 for one in seconds.values())
    rows = many_table({"match_many": 0.00025}).rows
    assert rows == [("match_many", "0.250 ms")]
