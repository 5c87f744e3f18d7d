"""Results do not move by accident: what the matchers, the odometry and SLAM answer is held by a file."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from tests.golden import FILE, answers

# other processors and versions of NumPy round sines differently: 1e-16, grown by up to 1e6 in an
# ill-conditioned least squares; a change of the algorithm moves results by more
ROUNDING = 1e-7


@pytest.mark.slow
def test_every_answer_is_the_one_on_file() -> None:
    golden: list[dict[str, Any]] = json.loads(FILE.read_text())
    now = list(answers())
    assert [one["name"] for one in now] == [one["name"] for one in golden]
    for new, old in zip(now, golden, strict=True):
        name = old["name"]
        assert new["outcome"] == old["outcome"], name
        np.testing.assert_allclose(new["pose"], old["pose"], rtol=0, atol=ROUNDING, err_msg=name)
        np.testing.assert_allclose(new["covariance"], old["covariance"], rtol=1e-5, atol=1e-12, err_msg=name)
        for field in ("n_matched", "labels"):
            assert new.get(field) == old.get(field), (name, field)


def test_the_file_holds_matches_failures_and_every_label() -> None:
    golden = json.loads(FILE.read_text())
    outcomes = {one["outcome"] for one in golden}
    assert {"MATCHED", "UNSUPPORTED"} <= outcomes
    labels = "".join("".join(one.get("labels", ())) for one in golden)
    assert set("01234") <= set(labels)
