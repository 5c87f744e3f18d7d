"""The odometry that a command line asks for."""

from __future__ import annotations

from dataclasses import replace

from curvescan.cli.options import Chain, ChainConfigs, Method, MethodConfigs
from curvescan.odometry import Odometry, OdometryConfig


def make_odometry(
    method: Method,
    chain: Chain,
    configs: MethodConfigs,
    chain_config: ChainConfigs,
    *,
    deskew: bool = True,
) -> Odometry:
    """Return a fresh odometry; "auto" chains by key scans where they suit the matcher."""
    uses_keys = chain == "keys" or (chain == "auto" and OdometryConfig.keys_suit(method))
    given = chain_config.odometry
    config = given if uses_keys else OdometryConfig.scan_to_scan()
    config = replace(config, deskew=deskew and given.deskew)
    return Odometry(method, config=config, matcher=configs.of(method))
