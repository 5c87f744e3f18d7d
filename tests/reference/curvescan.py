"""Slow, obvious twins of the default matcher's kernels, written from the words of their docstrings."""

from __future__ import annotations

import itertools

import numpy as np

from curvescan import se2


def segments(points, ranges, beams, n_beams, is_closed, step, incidence_limit, max_gap, jump):
    """Lists of reading numbers, one a surface, in sweep order; the seam of a closed sweep joined."""
    n = len(points)
    groups = []
    for i in range(n):
        skipped = (beams[i] - beams[i - 1]) % n_beams if n > 1 else n_beams
        is_same = 0 < skipped <= max_gap + 1
        if is_same:
            angle = skipped * step
            slope = (
                np.sin(angle) / np.sin(incidence_limit - angle)
                if angle < 0.9 * incidence_limit
                else 10.0 * np.sin(angle)
            )
            gap = np.linalg.norm(points[i] - points[i - 1])
            is_same = gap <= min(ranges[i], ranges[i - 1]) * slope + jump
        if i == 0 or not is_same:
            if i == 0 and is_same and is_closed and n > 2:
                groups.append(["joins the last", i])
            else:
                groups.append([i])
        else:
            groups[-1].append(i)
    if len(groups) > 1 and groups[0][0] == "joins the last":
        groups[-1] += groups.pop(0)[1:]
    return [[i for i in group if i != "joins the last"] for group in groups]


def line(points):
    """Centre, unit direction, sums of squares across and along, by the eigenvectors of the scatter."""
    centre = points.mean(axis=0)
    values, vectors = np.linalg.eigh((points - centre).T @ (points - centre))
    return centre, vectors[:, 1], values[0], values[1]


def reading_at(point, angles, lookup_by_beam, reach=None):
    """Reading of the beam nearest in direction; -2 when none lies within reach: half a step and a little."""
    off = np.abs(se2.wrap(np.arctan2(point[1], point[0]) - angles))
    beam = int(np.argmin(off))
    step = abs(angles[1] - angles[0])
    reach = 0.5 * step + 3e-5 if reach is None else reach
    return lookup_by_beam[beam] if off[beam] <= reach else -2


def beside(point, angles, lookup_by_beam):
    """Reading of the beam second nearest in direction, if it lies within one step; else a negative number."""
    off = np.abs(se2.wrap(np.arctan2(point[1], point[0]) - angles))
    beam = int(np.argsort(off)[1])
    return lookup_by_beam[beam] if off[beam] <= abs(angles[1] - angles[0]) + 3e-5 else -2


def score_samples(samples, image, find, find_beside, pose, tolerance, slope):
    """Agreements less half the contradictions; `find` gives the reading in the direction of a point.

    `find_beside` gives that of the beam on the other side: who stands between two beams contradicts only in front
    of both.
    """
    score = 0.0
    rotation = se2.rotation(pose[2])
    for probe in samples:
        point = rotation @ probe[:2] + pose[:2]
        j = find(point)
        if j < 0:
            continue
        surfel = image.surfels[j]
        noise = 2.0 * np.sqrt(max(probe[7], 0.0) + max(surfel[7], 0.0))
        limit = max(tolerance + slope * surfel[2], noise)
        across = surfel[5:7] @ (point - surfel[3:5])
        alike = surfel[5:7] @ (rotation @ probe[5:7])
        reach = np.hypot(3.0 * limit, 0.6 * surfel[10])
        if abs(across) < limit and np.linalg.norm(point - surfel[:2]) < reach and alike > 0:
            score += (1.0 - (across / limit) ** 2) * alike
            continue
        i = find_beside(point)
        seen = surfel[2] if i < 0 else min(surfel[2], image.surfels[i, 2])
        if np.linalg.norm(point) < seen - 2.0 * limit:
            score -= 0.5
    return score


def residual(pose, point_a, surfel_b, inverse):
    """Distance of a reading from the other scan's line, at the pose of the current scan in the reference."""
    moved = se2.transform(se2.inverse(pose) if inverse else pose, point_a)
    return surfel_b[5:7] @ (moved - surfel_b[3:5])


def jacobian(pose, point_a, surfel_b, inverse, h=1e-6):
    """(3,) derivative of the residual by the pose, by central differences."""
    steps = h * np.eye(3)
    return np.array(
        [
            (residual(pose + s, point_a, surfel_b, inverse) - residual(pose - s, point_a, surfel_b, inverse)) / (2 * h)
            for s in steps
        ]
    )


def information(surfels_ref, partner_ref, surfels_cur, partner_cur, pose):
    """(3, 3) information over x, y, theta before tilt is taken off, and the scale of the residuals."""
    total = np.zeros((3, 3))
    squares = []
    for surfels, others, partner, inverse in (
        (surfels_cur, surfels_ref, partner_cur, False),
        (surfels_ref, surfels_cur, partner_ref, True),
    ):
        for surfel, j in zip(surfels, partner, strict=True):
            if j < 0 or surfel[7] < 0 or others[j, 7] < 0:
                continue
            slope = jacobian(pose, surfel[:2], others[j], inverse)
            total += np.outer(slope, slope) / (surfel[7] + others[j, 7] + surfel[11] + others[j, 11])
            e = residual(pose, surfel[:2], others[j], inverse)
            squares.append(e * e / (surfel[7] + 0.3 * others[j, 7]))
    return 0.5 * total / max(np.mean(squares), 1.0)


def turn_likeness(histogram_ref, histogram_cur):
    """(n,) circular correlation of two histograms at every shift of the current one."""
    n = len(histogram_ref)
    return np.array([np.roll(histogram_cur, shift) @ histogram_ref for shift in range(n)])


def has_moved(surfels, bounds, partner, others, pose, inverse, least):
    """(m,) True on surfaces whose readings lie to one side of their partners' lines on the mean."""
    has_moved = np.zeros(len(surfels), dtype=bool)
    for start, stop in itertools.pairwise(bounds):
        rows = [i for i in range(start, stop) if partner[i] >= 0 and surfels[i, 7] > 0 and others[partner[i], 7] > 0]
        if len(rows) < 4:
            continue
        distances = [residual(pose, surfels[i, :2], others[partner[i]], inverse) for i in rows]
        variances = [surfels[i, 7] + others[partner[i], 7] for i in rows]
        deviation = np.sqrt(np.sum(variances)) / len(rows)
        has_moved[start:stop] = abs(np.mean(distances)) > max(4.0 * deviation, least)
    return has_moved


def confidence_terms(evidence, prior, wide_prior):
    """What the confidence weighs of a pose by (7,) its evidence, by name."""
    agreeing, excess, weakest, misfit, seen_through = np.maximum(evidence[:5], 0.0)
    return {
        "constant": 1.0,
        "log10_agreeing": np.log10(agreeing + 0.1),
        "log10_weakest": np.log10(weakest + 0.1),
        "log10_misfit": np.log10(misfit + 0.1),
        "log10_seen_through": np.log10(seen_through / (agreeing + 0.1) + 0.1),
        "prior": prior,
        "few_prior": max(1.0 - (excess + 0.1) / 2.0, 0.0) * wide_prior,
    }
