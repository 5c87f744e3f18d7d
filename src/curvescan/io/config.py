"""Configurations to TOML files and back: one table a method, one sub-table a stage."""

import os
import tomllib
from collections.abc import Mapping
from typing import Any

from curvescan.configs import as_plain, changed, check_names
from curvescan.errors import InvalidArgumentError, LogFileError
from curvescan.io.files.lines import as_path, printable
from curvescan.io.files.output import output_file

_MAX_CHARS = 1 << 15  # all parameters of all methods take 5,000; the parser's time grows with the square of the depth


def write_config(path: str | os.PathLike[str], configs: Mapping[str, object]) -> None:
    """Write configurations as TOML.

    Parameters
    ----------
    path : str or path-like
        The file, replaced if it exists.
    configs : mapping of str to dataclass
        Table name, a method's say, to its configuration; nested dataclasses become sub-tables.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    import tomli_w

    tables = {name: as_plain(config) for name, config in configs.items()}
    with output_file(path) as new:
        new.write_text(tomli_w.dumps(tables), encoding="utf-8", newline="\n")


def read_config(path: str | os.PathLike[str], defaults: Mapping[str, object]) -> dict[str, Any]:
    """Return configurations read from TOML; what the file leaves out keeps its default.

    Parameters
    ----------
    path : str or path-like
        A file as :func:`write_config` makes it.
    defaults : mapping of str to dataclass
        Table name to the configuration that the file changes.

    Returns
    -------
    dict of str to dataclass
        One for each name in `defaults`.

    Raises
    ------
    LogFileError
        When the file cannot be opened.
    InvalidArgumentError
        When it is no TOML, or holds an unknown key (the message names the nearest known one) or a value out of range.
    """
    file_path = as_path(path, "a configuration")
    try:
        with file_path.open(encoding="utf-8") as file:
            text = file.read(_MAX_CHARS + 1)
        if len(text) > _MAX_CHARS:
            raise ValueError(f"it is longer than {_MAX_CHARS:,} characters")
        tables = tomllib.loads(text)
    except OSError as error:
        raise LogFileError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        reason = printable(str(error), 200)
        raise InvalidArgumentError(f"{path} is not a TOML file: {reason}") from error
    check_names(tables, defaults, str(path))
    return {name: changed(default, tables.get(name, {}), f"{path}: [{name}]") for name, default in defaults.items()}
