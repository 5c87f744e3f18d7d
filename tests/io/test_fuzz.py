"""A small campaign of hostile files over every reader; ``python -m tests.fuzz`` is the large one."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from curvescan.errors import CurvescanError
from tests.fuzzing import check, targets

N_FILES = 150


@pytest.mark.parametrize("name", list(targets(Path())))
def test_hostile_files_give_a_result_or_a_sentence(tmp_path: Path, name: str) -> None:
    target = targets(tmp_path)[name]()
    path = tmp_path / "file"
    rng = random.Random(20)
    for data in target.seeds:
        check(target, path, data, rng)
    for _ in range(N_FILES):
        check(target, path, target.hostile(rng), rng)


@pytest.mark.parametrize("name", list(targets(Path())))
def test_seeds_are_sound_and_mutations_reach_further(tmp_path: Path, name: str) -> None:
    """Files that all fail in their first bytes would try nothing."""
    target = targets(tmp_path)[name]()
    path = tmp_path / "file"
    rng = random.Random(3)
    n_read = 0
    for _ in range(N_FILES):
        path.write_bytes(target.hostile(rng))
        try:
            target.read(path, rng)
        except CurvescanError:
            continue
        n_read += 1
    # a configuration is all or nothing: most changes of a value break a rule
    assert 2 < n_read < N_FILES - 3
