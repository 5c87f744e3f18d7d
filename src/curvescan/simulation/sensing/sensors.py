"""Laser scanners: where their beams point, how far they see, how they err."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from curvescan.configs import look_up, shipped_table
from curvescan.errors import require
from curvescan.simulation.buildings.world import World
from curvescan.types import Floats, Ints, Pose


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A laser scanner. Its sweep is instantaneous, or takes `time_increment` a beam and is distorted by motion."""

    name: str  # name for titles and messages
    n_beams: int  # beams of a sweep, >= 1
    angle_min: float  # direction of beam 0 in the sensor frame, radians
    angle_increment: float  # from a beam to the next, radians; not 0; negative for a clockwise sensor
    # limits of a reading, metres; 0 <= range_min < range_max
    range_min: float
    range_max: float
    sigma_range: float  # standard deviation of the Gaussian range noise, metres, >= 0, the same at all ranges
    dropout: float  # probability that a return is lost (dark or shiny surface), in [0, 1]
    period: float  # time from a sweep to the next, seconds, > 0
    # time from a beam to the next, seconds, >= 0; all beams of a sweep must fit into `period`
    time_increment: float = 0.0

    def __post_init__(self) -> None:
        sweep = self.n_beams * self.time_increment
        rules = {
            "n_beams must be >= 1": self.n_beams >= 1,
            "angle_increment must not be 0": self.angle_increment != 0.0,
            "limits must satisfy 0 <= range_min < range_max": 0.0 <= self.range_min < self.range_max,
            "range_max must be finite": math.isfinite(self.range_max),
            "sigma_range must be >= 0": self.sigma_range >= 0.0,
            "dropout must lie in [0, 1]": 0.0 <= self.dropout <= 1.0,
            "period must be > 0": self.period > 0.0,
            "time_increment must be >= 0, and n_beams of it at most a period": 0.0
            <= sweep
            <= self.period * (1.0 + 1e-9),
        }
        for rule, holds in rules.items():
            require(holds, rule, self)


SENSORS: Mapping[str, Sensor] = {
    name: Sensor(
        name=name,
        angle_min=math.radians(row.pop("angle_min_deg")),
        angle_increment=math.radians(row.pop("angle_increment_deg")),
        **row,
    )
    for name, row in shipped_table(__package__, "sensors.toml").items()
}
"""Name -> sensor, as sensors.toml has them."""


def choose_sensor(sensor: Sensor | str) -> Sensor:
    """Return a named sensor, or the sensor itself when it is one already. Raises InvalidArgumentError."""
    return sensor if isinstance(sensor, Sensor) else look_up(SENSORS, sensor, "sensor")


def sight(sensor: Sensor) -> float:
    """Return the range to which rays must be cast: noise brings surfaces just out of range into it."""
    return sensor.range_max + 8.0 * sensor.sigma_range


def cast_beams(
    world: World, pose: Pose, sensor: Sensor, *, range_max: float | None = None, people: Floats | None = None
) -> tuple[Floats, Ints]:
    """Return exact ranges of a sensor's beams and what each hits, as :func:`cast_rays`; range_max as the sensor's."""
    # Numba loads when something is cast
    from curvescan.simulation.sensing.raycast import cast_rays

    return cast_rays(
        world,
        pose,
        angle_min=sensor.angle_min,
        angle_increment=sensor.angle_increment,
        n_beams=sensor.n_beams,
        range_max=sensor.range_max if range_max is None else range_max,
        people=people,
    )


def measure(exact: Floats, sensor: Sensor, rng: np.random.Generator) -> Floats:
    """Return what a sensor reports for exact ranges, codes of REP-117; the same number of random draws for any."""
    noise = rng.standard_normal(exact.size)
    is_lost = rng.random(exact.size) < sensor.dropout
    ranges = exact + sensor.sigma_range * noise
    ranges[ranges > sensor.range_max] = np.inf
    ranges[ranges < sensor.range_min] = -np.inf
    ranges[is_lost & np.isfinite(exact)] = np.nan
    return ranges
