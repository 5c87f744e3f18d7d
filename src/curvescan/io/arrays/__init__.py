"""Scans from plain arrays: in memory, CSV, NPZ and CoreSLAM text."""
