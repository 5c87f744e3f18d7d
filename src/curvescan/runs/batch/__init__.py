"""Many logs: found, given to workers, noted in a manifest, a table of them all; what ``curvescan batch`` calls."""
