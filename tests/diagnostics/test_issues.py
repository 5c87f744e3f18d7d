"""Checks: from which share on what is counted is worth a word."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from curvescan.diagnostics.inspect import inspect_log
from curvescan.diagnostics.issues import find_issues
from tests.diagnostics.test_inspect import at


@pytest.fixture(scope="module")
def report():
    return inspect_log(at(0.0, 0.1, 0.2, 0.3))


@pytest.mark.parametrize(("share", "is_named"), [(0.03, False), (0.09, False), (0.1, True), (0.12, True), (0.3, True)])
def test_old_readings_are_named_from_a_tenth_on(report, share, is_named):
    """Below it they are those of beams that see the same to the last digit, as rounded ranges do."""
    issues = find_issues(replace(report, stale_share=share))
    assert ("stale_beams" in {issue.kind for issue in issues}) is is_named


def test_without_a_share_nothing_is_said(report):
    kinds = {issue.kind for issue in find_issues(replace(report, stale_share=np.nan))}
    assert "stale_beams" not in kinds
