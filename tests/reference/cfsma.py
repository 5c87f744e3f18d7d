"""CF-SMA written down slowly, equation by equation, for the fast stages to be compared with.

Plain loops and textbook formulas; nothing here is shared with the package.
"""

from __future__ import annotations

import math

import numpy as np


def segments(ranges, angles, *, is_closed, angle_step, range_sigma, incidence_limit, min_readings, max_gap):
    """Eq. 2: lists of consecutive reading indices, in sweep order from the first breakpoint."""
    n = len(ranges)
    if n == 0:
        return []

    def continues(before, i):
        step = angles[i] - angles[before]
        if i == 0:
            step += 2 * math.pi
        step = max(step, 0.0)
        n_missing = round(step / angle_step) - 1
        if n_missing > max_gap or step >= incidence_limit:
            return False
        a = (ranges[before] * math.cos(angles[before]), ranges[before] * math.sin(angles[before]))
        b = (ranges[i] * math.cos(angles[i]), ranges[i] * math.sin(angles[i]))
        limit = ranges[before] * math.sin(step) / math.sin(incidence_limit - step)
        return math.dist(a, b) <= limit + 3 * range_sigma

    joined = [is_closed and continues(n - 1, 0)] + [continues(i - 1, i) for i in range(1, n)]
    start = joined.index(False) if False in joined else 0
    groups = []
    for step in range(n):
        i = (start + step) % n
        if step == 0 or not joined[i]:
            groups.append([])
        groups[-1].append(i)
    return [g for g in groups if len(g) >= min_readings]


def walk(points, arc_tolerance):
    """Eq. 3 for one segment: the largest k of every reading, all k being tried."""
    n = len(points)
    result = []
    for i in range(n):
        best = 0
        for k in range(1, n - i):
            arc = sum(math.dist(points[j], points[j + 1]) for j in range(i, i + k))
            chord = math.dist(points[i], points[i + k])
            if arc - chord < arc_tolerance or k == 1:
                best = k
        result.append(best)
    return result


def curvature(points, arc_tolerance):
    """Eqs. 4 and 5 for one segment: the turn of the chord from each reading to the next.

    Only of walks that end of themselves: where the segment cuts a walk short, 0 is taken.
    """
    reach = walk(points, arc_tolerance)
    theta = [
        math.atan2(points[i + k][1] - points[i][1], points[i + k][0] - points[i][0])
        for i, k in enumerate(reach)
        if k > 0
    ]
    eta = [0.0] * len(points)
    for i in range(len(theta) - 1):
        if i + reach[i] == len(points) - 1:
            break
        turn = theta[i + 1] - theta[i]
        eta[i] = math.atan2(math.sin(turn), math.cos(turn))
    return eta, reach


def resample(eta, length):
    """One function at the common length, of unit norm: its running sum, cut into equal shares."""
    running = np.concatenate([[0.0], np.cumsum(eta)])
    at = np.linspace(0.0, len(eta), length + 1)
    function = np.diff(np.interp(at, np.arange(len(eta) + 1), running))
    norm = np.linalg.norm(function)
    return function / norm if norm > 0 else function


def correlation(function_cur, function_ref):
    """Eq. 6 without a Fourier transform: the largest sum of products over all circular shifts."""
    return max(float(np.dot(function_cur, np.roll(function_ref, lag))) for lag in range(len(function_ref)))


def pair_functions(upsilon, min_correlation):
    """Best pair, then the best of what is left, down to U_c."""
    left = [(-upsilon[i, j], i, j) for i in range(upsilon.shape[0]) for j in range(upsilon.shape[1])]
    pairs = []
    for score, i, j in sorted(left):
        if -score >= min_correlation and all(i != p and j != q for p, q in pairs):
            pairs.append((i, j))
    return pairs


def characteristic(eta, min_curvature):
    """Eq. 7 with abs(eta) for one segment, inner readings only."""
    height = [abs(e) for e in eta]
    return [
        i for i in range(1, len(eta) - 1) if height[i] >= min_curvature and height[i - 1] < height[i] >= height[i + 1]
    ]


def neighbourhood(i, n_cur, j, n_ref, n):
    """How many readings lie before and after both points, at most n, equally in both."""
    return min(n, i, j), min(n, n_cur - 1 - i, n_ref - 1 - j)


def similarity(cur, i, ref, j, n):
    """Eqs. 8 and 9 for reading i of one segment and reading j of another."""
    before, after = neighbourhood(i, len(cur), j, len(ref), n)
    c = np.asarray(cur[i - before : i + after + 1])
    r = np.asarray(ref[j - before : j + after + 1])
    s = [np.corrcoef(c[:, axis], r[:, axis])[0, 1] for axis in (0, 1)]
    return max(s[0], 0.0) * max(s[1], 0.0)


def surviving_pairs(cur, points_cur, ref, points_ref, *, n, min_similarity, max_ambiguity):
    """The three rejections for the characteristic points of one pair of segments."""
    s = {(i, j): similarity(cur, i, ref, j, n) for i in points_cur for j in points_ref}
    pairs = []
    for i in points_cur:
        row = sorted(((s[i, j], j) for j in points_ref), reverse=True)
        if not row or row[0][0] <= min_similarity:
            continue
        best, j = row[0]
        column = sorted(((s[k, j], k) for k in points_cur), reverse=True)
        if column[0][1] != i:
            continue
        runners_up = [value for value, _ in row[1:2] + column[1:2]]
        if all(value <= max_ambiguity * best for value in runners_up):
            pairs.append((i, j))
    return pairs


def matched(pairs, n_cur, n_ref, n):
    """The readings around the surviving pairs, index by index, each pair once."""
    found = set()
    for i, j in pairs:
        before, after = neighbourhood(i, n_cur, j, n_ref, n)
        found |= {(i + k, j + k) for k in range(-before, after + 1)}
    return found


def align(ref, cur):
    """Eqs. 10-12 by singular value decomposition (Kabsch), which Lingemann's form must equal."""
    ref, cur = np.asarray(ref), np.asarray(cur)
    u, _, vt = np.linalg.svd((cur - cur.mean(0)).T @ (ref - ref.mean(0)))
    flip = np.diag([1.0, np.linalg.det(vt.T @ u.T)])
    turn = vt.T @ flip @ u.T
    shift = ref.mean(0) - turn @ cur.mean(0)
    error = sum(float(np.sum((m - (turn @ p + shift)) ** 2)) for m, p in zip(ref, cur, strict=True))
    return np.array([*shift, math.atan2(turn[1, 0], turn[0, 0])]), error


def covariance(cur, pose, error):
    """Eqs. 13-18 with the matrix M written out row by row."""
    turn = np.array([[math.cos(pose[2]), -math.sin(pose[2])], [math.sin(pose[2]), math.cos(pose[2])]])
    rows = []
    for p in np.asarray(cur):
        qx, qy = turn @ p
        rows += [[1.0, 0.0, -qy], [0.0, 1.0, qx]]
    m = np.array(rows)
    return np.linalg.inv(m.T @ m) * error / (2 * len(cur) - 3)
