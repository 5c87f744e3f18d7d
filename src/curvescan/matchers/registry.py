"""The table of matchers: a name, where its class lives, where its parameters live.

A row is all it takes to add one; nothing is imported until its name is used.
"""

from __future__ import annotations

import difflib
import importlib
from functools import lru_cache
from typing import Any, Protocol, cast

from curvescan.errors import InvalidArgumentError
from curvescan.matchers.result import MatchResult
from curvescan.scan import LaserScan
from curvescan.types import Pose

MATCHERS: dict[str, tuple[str, str]] = {
    "curvescan": (
        "curvescan.matchers.curvescan.matcher:CurvescanMatcher",
        "curvescan.matchers.curvescan.config:CurvescanConfig",
    ),
    "cfsma": (
        "curvescan.matchers.cfsma.matcher:CfSmaMatcher",
        "curvescan.matchers.cfsma.config:CfSmaConfig",
    ),
    "idc": (
        "curvescan.matchers.baselines.idc:IdcMatcher",
        "curvescan.matchers.baselines.config:IdcConfig",
    ),
    "cox": (
        "curvescan.matchers.baselines.cox:CoxMatcher",
        "curvescan.matchers.baselines.config:CoxConfig",
    ),
    "histogram": (
        "curvescan.matchers.baselines.histogram:HistogramMatcher",
        "curvescan.matchers.baselines.config:HistogramConfig",
    ),
    "icp": (
        "curvescan.matchers.baselines.icp:IcpMatcher",
        "curvescan.matchers.baselines.config:IcpConfig",
    ),
    "plicp": (
        "curvescan.matchers.baselines.plicp:PlIcpMatcher",
        "curvescan.matchers.baselines.config:PlIcpConfig",
    ),
}
"""Method name -> (matcher, its config), each as ``module:class``."""

DEFAULT_METHOD = "curvescan"


class Matcher(Protocol):
    """One algorithm that matches two scans. It holds its configuration and no other state."""

    @property
    def config(self) -> Any:
        """The matcher's frozen configuration."""
        ...

    def prepare(self, scan: LaserScan) -> Any:
        """Return the features of a scan, whatever this matcher needs to know of one scan."""
        ...

    def can_be_reference(self, features: Any) -> bool:
        """Return whether features hold enough for a later scan to be matched against them."""
        ...

    def match(self, reference: Any, current: Any, guess: Pose | None) -> MatchResult:
        """Return the pose of `current` seen from `reference`, both being features of this matcher."""
        ...


def find_matcher(method: str, config: object | None = None) -> Matcher:
    """Return the matcher of a name with a configuration, or with its defaults.

    Parameters
    ----------
    method : str
        A name of the table MATCHERS.
    config : object or None
        An instance of that matcher's config class.

    Raises
    ------
    InvalidArgumentError
        When the name is unknown, or the config is another matcher's.
    """
    if method not in MATCHERS:
        near = difflib.get_close_matches(str(method), MATCHERS, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise InvalidArgumentError(
            f"unknown method {method!r}: {hint}known are {', '.join(sorted(MATCHERS))}"
        )
    return _build(method, config)


@lru_cache(maxsize=64)
def _build(method: str, config: object | None) -> Matcher:
    config_class = _load(MATCHERS[method][1])
    if config is None:
        config = config_class()
    elif not isinstance(config, config_class):
        raise InvalidArgumentError(
            f"method {method!r} takes a {config_class.__name__}, got {type(config).__name__}"
        )
    return cast(Matcher, _load(MATCHERS[method][0])(config))


def _load(address: str) -> Any:
    module, _, name = address.partition(":")
    return getattr(importlib.import_module(module), name)
