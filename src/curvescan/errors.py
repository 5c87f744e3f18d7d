"""The errors curvescan raises: one root, and each also the builtin it refines.

A message names the rule that was broken, the value that broke it and, where there is one, the remedy.
A *reading* that is NaN, infinite, zero or out of range is data and never an error; a *match* that finds
no pose is a result (:class:`curvescan.Outcome`) and never an error.
"""


class CurvescanError(Exception):
    """Root of all errors raised on purpose by curvescan."""


class InvalidArgumentError(CurvescanError, ValueError):
    """An argument or a configuration value breaks a stated rule."""


class LogFileError(CurvescanError, OSError):
    """A log cannot be opened: missing, a directory, not readable."""


class LogFormatError(CurvescanError, ValueError):
    """A log or a trajectory can be opened but is not of a format that curvescan reads."""


class OutputError(CurvescanError, OSError):
    """Results cannot be written to the given place."""


class WorkerError(CurvescanError, RuntimeError):
    """The workers of a batch cannot be started."""


class StorageError(CurvescanError, OSError):
    """A bucket of an object store cannot be reached, or refuses a request."""


class SourceError(CurvescanError, OSError):
    """A running sensor cannot be opened, has gone, or sends nothing that can be read."""


class MapTooLargeError(InvalidArgumentError):
    """A map would take more memory than it may."""


class MissingPackageError(CurvescanError, ImportError):
    """An optional package is missing; the message gives the pip command."""


class UnitWarning(UserWarning):
    """Numbers that are allowed but look like another unit: ranges in millimetres, say."""


def require(holds: bool, rule: str, value: object) -> None:
    """Raise InvalidArgumentError with the rule and the value that breaks it, unless `holds`."""
    if not holds:
        raise InvalidArgumentError(f"{rule}, got {value!r}")
