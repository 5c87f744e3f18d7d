"""The odometry that a command line asks for."""

from __future__ import annotations

from curvescan.cli.options import Chain, ChainConfigs, Method, MethodConfigs
from curvescan.matching import DEFAULT_METHOD
from curvescan.odometry import Odometry, OdometryConfig


def make_odometry(
    method: Method, chain: Chain, configs: MethodConfigs, chain_config: ChainConfigs
) -> Odometry:
    """Return a fresh odometry; "auto" chains by key scans where the default matcher is asked for."""
    uses_keys = chain == "keys" or (chain == "auto" and method == DEFAULT_METHOD)
    config = chain_config.odometry if uses_keys else OdometryConfig.scan_to_scan()
    return Odometry(method, matcher_config=configs.of(method), config=config)
