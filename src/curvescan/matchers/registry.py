"""The table of matchers: a name, where its class lives, where its parameters live.

A row is all it takes to add one; nothing is imported until its name is used.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias, Union, cast

from curvescan.configs import as_config, look_up
from curvescan.matchers.result import MatchResult
from curvescan.scan import LaserScan
from curvescan.types import UncertainPose

if TYPE_CHECKING:
    from curvescan.matchers.baselines.config import CoxConfig, HistogramConfig, IcpConfig, IdcConfig, PlIcpConfig
    from curvescan.matchers.cfsma.config import CfSmaConfig
    from curvescan.matchers.curvescan.config import CurvescanConfig

Method: TypeAlias = Literal["curvescan", "cfsma", "idc", "cox", "histogram", "icp", "plicp"]
"""Names of the table MATCHERS, written out for editors and type checkers."""

MatcherConfig: TypeAlias = Union[
    "CurvescanConfig",
    "CfSmaConfig",
    "IdcConfig",
    "CoxConfig",
    "HistogramConfig",
    "IcpConfig",
    "PlIcpConfig",
    Mapping[str, Any],
]
"""What configures a matcher: an instance of its config class, or a mapping of the fields that differ."""

MATCHERS: dict[str, tuple[str, str]] = {
    "curvescan": (
        "curvescan.matchers.curvescan.matcher:CurvescanMatcher",
        "curvescan.matchers.curvescan.config:CurvescanConfig",
    ),
    "cfsma": ("curvescan.matchers.cfsma.matcher:CfSmaMatcher", "curvescan.matchers.cfsma.config:CfSmaConfig"),
    "idc": ("curvescan.matchers.baselines.idc:IdcMatcher", "curvescan.matchers.baselines.config:IdcConfig"),
    "cox": ("curvescan.matchers.baselines.cox:CoxMatcher", "curvescan.matchers.baselines.config:CoxConfig"),
    "histogram": (
        "curvescan.matchers.baselines.histogram:HistogramMatcher",
        "curvescan.matchers.baselines.config:HistogramConfig",
    ),
    "icp": ("curvescan.matchers.baselines.icp:IcpMatcher", "curvescan.matchers.baselines.config:IcpConfig"),
    "plicp": ("curvescan.matchers.baselines.plicp:PlIcpMatcher", "curvescan.matchers.baselines.config:PlIcpConfig"),
}
"""Method name -> (matcher, its config), each as ``module:class``."""

DEFAULT_METHOD = "curvescan"


class Matcher(Protocol):
    """One algorithm that matches two scans. It holds its configuration and no other state."""

    @property
    def config(self) -> Any:
        """The matcher's frozen configuration."""

    def prepare(self, scan: LaserScan) -> Any:
        """Return the features of a scan, whatever this matcher needs to know of one scan."""

    def can_be_reference(self, features: Any) -> bool:
        """Return whether features hold enough for a later scan to be matched against them."""

    def match(self, reference: Any, current: Any, prior: UncertainPose | None) -> MatchResult:
        """Return the pose of `current` seen from `reference`, both features of this matcher; prior None: WIDE_PRIOR."""


def find_matcher(method: Method | str, config: MatcherConfig | None = None, *, name: str = "config") -> Matcher:
    """Return the matcher of a name with a configuration, or with its defaults. Raises InvalidArgumentError."""
    look_up(MATCHERS, method, "method")
    if config is None:  # not left to _build: the hash of a configuration takes a while
        return _with_defaults(method)
    return _build(method, config_of(method, config, name=name))


def config_of(method: Method | str, config: MatcherConfig | None = None, *, name: str = "config") -> Any:
    """Return the whole configuration that :func:`find_matcher` uses; the arguments are the same."""
    look_up(MATCHERS, method, "method")
    return as_config(config, default_config(method), name=name, hint=f"method {method!r} takes no other")


@lru_cache(maxsize=len(MATCHERS))
def default_config(method: str) -> Any:
    """Return the configuration of a method that holds where none is given."""
    return pkgutil.resolve_name(MATCHERS[method][1])()


@lru_cache(maxsize=len(MATCHERS))
def _with_defaults(method: str) -> Matcher:
    return _build(method, default_config(method))


@lru_cache(maxsize=64)
def _build(method: str, config: object) -> Matcher:
    return cast(Matcher, pkgutil.resolve_name(MATCHERS[method][0])(config))
