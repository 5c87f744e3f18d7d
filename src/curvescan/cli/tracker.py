"""The odometry that a command line asks for."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from curvescan.cli.options import Chain, ChainConfigs, MethodConfigs
from curvescan.matchers.registry import Method
from curvescan.odometry.config import OdometryConfig

if TYPE_CHECKING:
    from curvescan.odometry import Odometry


def make_config(method: Method, chain: Chain, chain_config: ChainConfigs) -> OdometryConfig:
    """Return the configuration of the odometry; "auto" uses keyframes where they suit the matcher."""
    uses_keys = chain == "keys" or (chain == "auto" and OdometryConfig.keys_suit(method))
    given = chain_config.odometry
    config = given if uses_keys else OdometryConfig.scan_to_scan()
    return replace(config, deskew=given.deskew)


def make_odometry(method: Method, chain: Chain, configs: MethodConfigs, chain_config: ChainConfigs) -> Odometry:
    """Return a fresh odometry."""
    from curvescan.odometry import Odometry  # a batch that has nothing left to do needs no kernels

    config = make_config(method, chain, chain_config)
    return Odometry(method, config=config, matcher=configs.of(method))
