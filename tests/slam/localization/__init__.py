"""Tests of curvescan.slam.localization."""
