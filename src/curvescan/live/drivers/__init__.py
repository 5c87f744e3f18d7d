"""Drivers: lasers on a serial port or a network, through the packages of the extra ``curvescan[lidar]``."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from typing import TYPE_CHECKING

from curvescan.errors import InvalidArgumentError

if TYPE_CHECKING:
    from curvescan.live.sources import ScanSource


DRIVERS = {
    "lds2d": "curvescan.live.drivers.lds2d_source:Lds2dSource",
    "rplidar": "curvescan.live.drivers.rplidar_source:RplidarSource",
    "hokuyo": "curvescan.live.drivers.hokuyo_source:HokuyoSource",
}
"""Name of each driver -> its source, as ``module:class``."""


def open_driver(
    driver: str, port: str, *, is_mirrored: bool = False, ignore_beams: tuple[int, int] = (0, 0)
) -> ScanSource:
    """Return the source of a laser; it is opened when its context is entered. ignore_beams (int, int)."""
    name, *model = driver.split(":", 1)
    if name not in DRIVERS or bool(model) != (name == "lds2d"):
        raise InvalidArgumentError(
            f"there is no driver {driver!r}: the drivers are lds2d:MODEL (lds2d:LDROBOT-LD19, say), rplidar and hokuyo"
        )
    new: Callable[..., ScanSource] = pkgutil.resolve_name(DRIVERS[name])
    return new(*model, port, is_mirrored=is_mirrored, ignore_beams=ignore_beams)
