"""Occupancy maps the slow and obvious way: every cell of the box around a beam is cut with the beam."""

from __future__ import annotations

import math

import numpy as np


def cells_passed(start, end):
    """Return the cells (i, j) that a beam passes on more than a point, its last one included.

    A cell is cut with the beam side by side (Liang and Barsky 1984).
    """
    (x0, y0), (x1, y1) = start, end
    passed = set()
    for i in range(math.floor(min(x0, x1)), math.floor(max(x0, x1)) + 1):
        for j in range(math.floor(min(y0, y1)), math.floor(max(y0, y1)) + 1):
            enter, leave = 0.0, 1.0
            for at, way, low in ((x0, x1 - x0, i), (y0, y1 - y0, j)):
                if way == 0.0:
                    if not low <= at < low + 1:
                        leave = -1.0
                    continue
                first, second = sorted(((low - at) / way, (low + 1 - at) / way))
                enter, leave = max(enter, first), min(leave, second)
            if enter < leave:
                passed.add((i, j))
    return passed | {(math.floor(x1), math.floor(y1))}


def occupancy(scans, poses, ignored, config):
    """Return {(i, j): log-odds} of the cells that were seen, i and j counted from the frame's origin."""
    log_odds = {}
    hit, miss, lowest, highest = (
        math.log(p / (1 - p)) for p in (config.hit, config.miss, config.lowest, config.highest)
    )
    for scan, (x, y, theta), left_out in zip(scans, poses, ignored, strict=True):
        hits, passed = set(), set()
        start = (x / config.resolution, y / config.resolution)
        for beam, reading in enumerate(scan.ranges):
            angle = theta + scan.angle_min + beam * scan.angle_increment
            is_valid = scan.range_min <= reading <= scan.range_max and reading > 0
            is_fully_observed = config.clear_no_return and reading == np.inf and scan.range_max <= 1e4
            if not is_valid and not is_fully_observed:
                continue
            reach = reading if is_valid else scan.range_max
            end = ((x + reach * math.cos(angle)) / config.resolution, (y + reach * math.sin(angle)) / config.resolution)
            last = (math.floor(end[0]), math.floor(end[1]))
            cells = cells_passed(start, end)
            passed |= cells if is_fully_observed else cells - {last}
            if is_valid and not left_out[beam]:
                hits.add(last)
        for cell in hits:
            log_odds[cell] = min(log_odds.get(cell, 0.0) + hit, highest)
        for cell in passed - hits:
            log_odds[cell] = max(log_odds.get(cell, 0.0) + miss, lowest)
    return log_odds
