"""What a log's scans say of its sensor: in which order the beams were swept, and which way it turns.

Judged once, here, for `info`, for :func:`curvescan.run` and for every odometry made with
:func:`curvescan.odometry_for`, so that all of them say and do the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

from curvescan.configs import as_config
from curvescan.diagnostics.beam_order import BeamOrder, judge_beam_order
from curvescan.diagnostics.rotation_direction import RotationDirection, rotation_of_log
from curvescan.io.log import Log
from curvescan.matchers.registry import DEFAULT_METHOD, MatcherConfig, Method
from curvescan.odometry import Odometry, OdometryConfig

_N_ORDER_SCANS = 300


@dataclass(frozen=True, kw_only=True)
class SensorJudgement:
    """What a log's scans say of its sensor."""

    beam_order: BeamOrder | None  # in which order the beams were swept; None where the scans have no beam times
    # how the turns of the scans compare with those of wheels or gyroscope; None without either
    rotation: RotationDirection | None

    @property
    def can_deskew(self) -> bool:
        """Whether sweeps can be deskewed by their beam times: not where the beams are listed in reverse."""
        return self.beam_order is None or not self.beam_order.is_reversed_order


def judge_sensor(log: Log, *, is_order_needed: bool = True) -> SensorJudgement:
    """Return what a log's scans say of its sensor."""
    order = beam_order_of_log(log) if is_order_needed else None
    return SensorJudgement(beam_order=order, rotation=rotation_of_log(log))


def beam_order_of_log(log: Log) -> BeamOrder | None:
    """Return in which order the beams of a log's first 300 scans were swept; None where they have no beam times."""
    first = next(iter(log), None)
    if first is None or first.time_increment <= 0.0:
        return None
    return judge_beam_order(islice(log, _N_ORDER_SCANS))


def odometry_for(
    log: Log,
    method: Method | str = DEFAULT_METHOD,
    *,
    config: OdometryConfig | Mapping[str, Any] | None = None,
    matcher: MatcherConfig | None = None,
) -> Odometry:
    """Return a fresh odometry for the scans of a log, as ``curvescan odometry`` uses it.

    It does not deskew sweeps whose beams the log lists in reverse.

    Parameters
    ----------
    log : Log
        Whose scans will be added.
    method, config, matcher
        As :class:`curvescan.Odometry` takes them.

    Raises
    ------
    InvalidArgumentError
        When the method is unknown, or a configuration is of another class or has an unknown key.
    """
    hint = "the configuration of the matcher is given as matcher="
    config = as_config(config, OdometryConfig.of_method(method), hint=hint)
    if config.deskew:
        judged = SensorJudgement(beam_order=beam_order_of_log(log), rotation=None)
        config = replace(config, deskew=judged.can_deskew)
    return Odometry(method, config=config, matcher=matcher)
