"""Slow twin of curvescan.simulation.sensing.raycast: every beam against every primitive, in the beam's own frame.

Each primitive is turned into the frame whose x axis is the beam; there a hit is a crossing of the line
y = 0 at x >= 0. Nothing is shared with the fast version but the meaning of a world.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

NEAR = 1e-6
"""Metres: a beam that passes an end or a tangent this close may rightly be decided either way."""


@dataclass(frozen=True)
class Table:
    """(n_beams, n_primitives) tables: distance (inf: no hit), sine of incidence, doubtful or not."""

    distance: np.ndarray
    sine: np.ndarray
    is_doubtful: np.ndarray


def cast_all(walls, boxes, circles, arcs, pose, angles) -> Table:
    """Cast beams at `angles` (sensor frame) at segments, circles and arcs, in this order."""
    segments = [(complex(w[0], w[1]), complex(w[2], w[3])) for w in walls]
    for x, y, length, width, angle in boxes:
        turn, half = cmath.rect(1.0, angle), (0.5 * length, 0.5 * width)
        corners = [
            complex(x, y) + turn * complex(sx * half[0], sy * half[1])
            for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        segments += [(corners[k], corners[(k + 1) % 4]) for k in range(4)]
    rounds = [(*c, 0.0, 2.0 * math.pi) for c in circles] + [tuple(a) for a in arcs]
    shape = (len(angles), len(segments) + len(rounds))
    distance, sine = np.full(shape, np.inf), np.ones(shape)
    is_doubtful = np.zeros(shape, dtype=bool)
    origin = complex(pose[0], pose[1])
    for j, angle in enumerate(angles):
        to_beam = cmath.rect(1.0, -(pose[2] + angle))
        for i, (start, end) in enumerate(segments):
            a, b = (start - origin) * to_beam, (end - origin) * to_beam
            is_doubtful[j, i] = min(abs(a.imag), abs(b.imag)) < NEAR
            if (a.imag > 0.0) != (b.imag > 0.0):
                x = a.real + (b.real - a.real) * a.imag / (a.imag - b.imag)
                is_doubtful[j, i] |= abs(x) < NEAR
                if x >= 0.0:
                    distance[j, i] = x
                    sine[j, i] = abs(a.imag - b.imag) / abs(b - a)
        for k, (x, y, radius, first, extent) in enumerate(rounds, start=len(segments)):
            centre = (complex(x, y) - origin) * to_beam
            is_doubtful[j, k] = abs(abs(centre.imag) - radius) < NEAR
            if abs(centre.imag) > radius:
                continue
            half_chord = math.sqrt(radius**2 - centre.imag**2)
            for crossing in (centre.real + half_chord, centre.real - half_chord):
                is_doubtful[j, k] |= abs(crossing) < NEAR
                world = (crossing - centre) / to_beam
                along = math.remainder(cmath.phase(world) - first, 2.0 * math.pi) % (2.0 * math.pi)
                if extent < 2.0 * math.pi:
                    ends = [abs(math.remainder(along - e, 2.0 * math.pi)) for e in (0.0, extent)]
                    is_doubtful[j, k] |= min(ends) * radius < NEAR
                if crossing >= 0.0 and along <= extent:
                    distance[j, k] = crossing  # the near crossing comes last
                    sine[j, k] = half_chord / radius
    return Table(distance, sine, is_doubtful)
