"""Keyframes: the few scans that later ones are matched with; each was placed by a match with an earlier one."""

from __future__ import annotations

from dataclasses import dataclass

from curvescan.matchers import PreparedScan
from curvescan.se2.uncertain import UncertainPose, between, compose


@dataclass(frozen=True, eq=False, kw_only=True)
class Keyframe:
    """One keyframe."""

    scan: PreparedScan  # the scan, ready to be matched with
    index: int  # number of the scan in the stream
    pose_map_keyframe: UncertainPose  # its sensor in the frame of the first scan


@dataclass(frozen=True, eq=False, kw_only=True)
class Localization:
    """Where a scan is, relative to a keyframe."""

    keyframe: Keyframe  # the keyframe
    pose_keyframe_scan: UncertainPose  # the scan seen from it
    is_measured: bool = False  # whether a match measured all of it, with no direction left to what was expected

    @property
    def pose_map_scan(self) -> UncertainPose:
        """The scan in the frame of the first one."""
        return compose(self.keyframe.pose_map_keyframe, self.pose_keyframe_scan)

    def moved(self, motion: UncertainPose) -> Localization:
        """Return where a motion leads from here."""
        return Localization(keyframe=self.keyframe, pose_keyframe_scan=compose(self.pose_keyframe_scan, motion))

    def relative_to(self, keyframe: Keyframe) -> UncertainPose:
        """Return the same place seen from another keyframe, an earlier one or the same."""
        if keyframe is self.keyframe:
            return self.pose_keyframe_scan
        return between(keyframe.pose_map_keyframe, self.pose_map_scan)

    def as_keyframe(self, scan: PreparedScan, index: int, variance_retained: float) -> Keyframe:
        """Return a keyframe at this place; of the variance that a match measured a share is retained."""
        share = variance_retained if self.is_measured else 1.0
        here = UncertainPose(self.pose_keyframe_scan.pose, share * self.pose_keyframe_scan.cov)
        return Keyframe(scan=scan, index=index, pose_map_keyframe=compose(self.keyframe.pose_map_keyframe, here))
