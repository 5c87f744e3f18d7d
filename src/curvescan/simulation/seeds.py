"""Child seeds: one for each purpose, so that one random thing never shifts another."""

from __future__ import annotations

import numpy as np

from curvescan.errors import InvalidArgumentError

WORLD, PATH, NOISE, PEOPLE, ODOMETRY, PAIR = range(6)
"""The purposes. Their numbers are part of the simulated data: never renumber, only add."""


def child(seed: int | np.random.SeedSequence, *key: int) -> np.random.SeedSequence:
    """Return the seed of one purpose (and index): a function of the root seed and the key alone."""
    if isinstance(seed, np.random.SeedSequence):
        return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, *key))
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise InvalidArgumentError(f"seed must be an integer >= 0, got {seed!r}")
    return np.random.SeedSequence(int(seed), spawn_key=key)
