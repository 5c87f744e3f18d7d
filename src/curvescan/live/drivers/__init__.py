"""Drivers: lasers on a serial port or a network, through the packages of the extra ``curvescan[lidar]``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from curvescan.errors import InvalidArgumentError

if TYPE_CHECKING:
    from curvescan.live.sources import ScanSource


DRIVERS = ("lds2d", "rplidar", "hokuyo")  # names of the drivers


def open_driver(
    driver: str, port: str, *, is_mirrored: bool = False, ignore_beams: tuple[int, int] = (0, 0)
) -> ScanSource:
    """Return the source of a laser; it is opened when its context is entered. ignore_beams (int, int)."""
    name, _, model = driver.partition(":")
    if name == "lds2d" and model:
        from curvescan.live.drivers.lds2d_source import Lds2dSource

        return Lds2dSource(model, port, is_mirrored=is_mirrored, ignore_beams=ignore_beams)
    if name == "rplidar" and not model:
        from curvescan.live.drivers.rplidar_source import RplidarSource

        return RplidarSource(port, is_mirrored=is_mirrored, ignore_beams=ignore_beams)
    if name == "hokuyo" and not model:
        from curvescan.live.drivers.hokuyo_source import HokuyoSource

        return HokuyoSource(port, is_mirrored=is_mirrored, ignore_beams=ignore_beams)
    raise InvalidArgumentError(
        f"there is no driver {driver!r}: the drivers are lds2d:MODEL (lds2d:LDROBOT-LD19, say), rplidar and hokuyo"
    )
