"""The bench of stages: where the time of a matcher goes."""

from pathlib import Path

import curvescan as cs
from stages import REST, measure_stages, stage_table


def test_the_time_of_each_stage_is_that_of_its_file():
    stages = {one.stage: one for one in measure_stages("cfsma", n_pairs=2)}
    assert list(stages)[-1] == REST
    package = Path(cs.__file__).parent
    assert all((package / stage).is_file() for stage in stages if stage != REST)
    # a scan's curvature belongs to it alone, its landmarks are found in it and paired with another's
    curvature, landmarks = (stages["matchers/cfsma/curvature.py"], stages["matchers/cfsma/landmarks.py"])
    assert curvature.prepare_seconds > 0 == curvature.match_seconds == curvature.guess_seconds
    assert min(landmarks.prepare_seconds, landmarks.match_seconds, landmarks.guess_seconds) > 0
    (row, *_) = stage_table(list(stages.values())).rows
    assert row[0] == "cfsma"
