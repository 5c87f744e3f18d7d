"""The named worlds: one explicit table, name -> builder."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from curvescan.configs import shipped_table
from curvescan.errors import InvalidArgumentError
from curvescan.simulation.buildings.floor import building
from curvescan.simulation.buildings.offices import office
from curvescan.simulation.buildings.rooms import (
    clutter,
    columns,
    corridor,
    curved_hall,
    l_hall,
    room,
    round_room,
    t_hall,
)
from curvescan.simulation.buildings.world import World

_T = TypeVar("_T")

Seed = int | np.random.SeedSequence  # what decides a random world: the same seed, the same bits

_PLACED = shipped_table(__package__, "worlds.toml")

WORLDS: Mapping[str, Callable[[Seed], World]] = {
    "room": lambda _: room(),
    "corridor": lambda _: corridor(**_PLACED["corridor"], has_ends=True),
    "bare-corridor": lambda _: corridor(),
    "round-room": lambda _: round_room(),
    "l-hall": lambda _: l_hall(),
    "t-hall": lambda _: t_hall(),
    "curved-hall": lambda _: curved_hall() + columns(_PLACED["curved-hall"]["columns"]),
    "clutter": lambda seed: room(10.0, 8.0) + clutter((-4.5, -3.5, 4.5, 3.5), 18, seed),
    "office": office,
    "building": building,
    "office-floor": lambda seed: replace(building(seed, visits_round_room=False), name="office-floor"),
}
"""Name -> builder(seed). Only clutter, office, building and office-floor (the building, whose route leaves the round
room out) depend on the seed."""


def build_world(world: World | str, seed: Seed = 0) -> World:
    """Return a named world built with a seed, or the world itself when it is one already."""
    if isinstance(world, World):
        return world
    return look_up(WORLDS, world, "world")(seed)


def look_up(table: Mapping[str, _T], name: str, what: str) -> _T:
    """Return an entry of a table of names, or raise an error that names the nearest one."""
    if name in table:
        return table[name]
    near = difflib.get_close_matches(str(name), table, n=1, cutoff=0.0)
    raise InvalidArgumentError(f"unknown {what} {name!r}: did you mean {near[0]!r}? known are {', '.join(table)}")
