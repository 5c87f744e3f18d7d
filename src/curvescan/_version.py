"""The version of the package, which results are marked with."""

__version__ = "0.1.0"
