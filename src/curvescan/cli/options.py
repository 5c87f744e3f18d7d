"""Arguments that several commands take."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import tyro

from curvescan.cfsma.config import CfSmaConfig
from curvescan.consensus.config import ConsensusConfig
from curvescan.mapping.config import OccupancyConfig
from curvescan.rivals.config import (
    CoxConfig,
    HistogramConfig,
    IcpConfig,
    IdcConfig,
    PlIcpConfig,
)

LogPath: TypeAlias = Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG")]
"""The log to read."""

ScanNumber: TypeAlias = tyro.conf.Positional[int]
"""Number of a scan in its log."""

Method: TypeAlias = Literal["curvescan", "cfsma", "idc", "cox", "histogram", "icp", "plicp"]
"""Names of the table of matchers, written out so that --help loads none of them."""


@dataclass(frozen=True, kw_only=True)
class MethodConfigs:
    """Parameters of every method; those of the method that runs are used."""

    curvescan: ConsensusConfig = field(default_factory=ConsensusConfig)
    """The default matcher."""
    cfsma: CfSmaConfig = field(default_factory=CfSmaConfig)
    """CF-SMA (Núñez et al. 2009)."""
    idc: IdcConfig = field(default_factory=IdcConfig)
    """Iterative dual correspondence (Lu and Milios 1997)."""
    cox: CoxConfig = field(default_factory=CoxConfig)
    """Points to lines (Cox 1991)."""
    histogram: HistogramConfig = field(default_factory=HistogramConfig)
    """Angle, x and y histograms (Weiss and v. Puttkamer 1995)."""
    icp: IcpConfig = field(default_factory=IcpConfig)
    """Point to point ICP (Besl and McKay 1992); needs SciPy."""
    plicp: PlIcpConfig = field(default_factory=PlIcpConfig)
    """Point to line ICP (Censi 2008)."""

    def of(self, method: Method) -> object:
        """Return the parameters of one method."""
        return getattr(self, method)


ConfigFile: TypeAlias = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
"""A TOML file of parameters, as `curvescan calibrate` writes it; main() reads it, and flags change what it says."""

Configs: TypeAlias = Annotated[MethodConfigs, tyro.conf.arg(name="")]
"""Parameters of all methods, as flags --METHOD.PARAMETER."""
Topic: TypeAlias = str | None
"""Topic of a ROS bag; None for the only one with laser scans."""

MapConfig: TypeAlias = Annotated[OccupancyConfig, tyro.conf.arg(name="map")]
"""Parameters of the occupancy map, as flags --map.PARAMETER."""
