"""Configurations to TOML files and back: one table a method, one sub-table a stage."""

from __future__ import annotations

import difflib
import os
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from curvescan.errors import InvalidArgumentError, LogFileError
from curvescan.io.files.printable import printable

_MAX_CHARS = 1 << 15
"""All parameters of all methods take 5,000; the parser's time grows with the square of the depth."""


def write_config(path: str | os.PathLike[str], configs: Mapping[str, object]) -> None:
    """Write configurations as TOML.

    Parameters
    ----------
    path : str or path-like
        The file, replaced if it exists.
    configs : mapping of str to dataclass
        Table name, a method's say, to its configuration; nested dataclasses become sub-tables.
    """
    lines = [line for name, config in configs.items() for line in _tables(name, config)]
    Path(path).write_text("\n".join(lines).lstrip("\n") + "\n", encoding="utf-8")


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
    try:
        with Path(path).open(encoding="utf-8") as file:
            text = file.read(_MAX_CHARS + 1)
        if len(text) > _MAX_CHARS:
            raise ValueError(f"it is longer than {_MAX_CHARS:,} characters")
        tables = tomllib.loads(text)
    except OSError as error:
        raise LogFileError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        reason = printable(str(error), 200)
        raise InvalidArgumentError(f"{path} is not a TOML file: {reason}") from error
    _check_names(tables, defaults, str(path))
    return {
        name: _changed(default, tables.get(name, {}), f"{path}: [{name}]")
        for name, default in defaults.items()
    }


def _tables(name: str, config: object) -> Iterator[str]:
    assert is_dataclass(config)
    nested, lines = [], []
    for field in fields(config):
        value = getattr(config, field.name)
        if is_dataclass(value):
            nested.append((f"{name}.{field.name}", value))
        else:
            lines.append(f"{field.name} = {_literal(value)}")
    if lines:
        yield from ("", f"[{name}]", *lines)
    for inner_name, inner in nested:
        yield from _tables(inner_name, inner)


def _changed(default: Any, table: object, where: str) -> Any:
    if not isinstance(table, dict):
        raise InvalidArgumentError(f"{where} must be a table, got {table!r:.80}")
    values = {field.name: getattr(default, field.name) for field in fields(default)}
    _check_names(table, values, where)
    hints = get_type_hints(type(default))
    for name, value in table.items():
        if is_dataclass(values[name]):
            values[name] = _changed(values[name], value, f"{where[:-1]}.{name}]")
        else:
            values[name] = _as_type_of(values[name], value, f"{where} {name}")
            _check_length(hints[name], values[name], f"{where} {name}")
    try:
        return type(default)(**values)
    except InvalidArgumentError as error:
        raise InvalidArgumentError(f"{where}: {error}") from error


def _literal(value: object) -> str:
    """Return a value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(_literal(one) for one in value)}]"
    return repr(value)


def _as_type_of(default: object, value: object, where: str) -> object:
    if isinstance(default, tuple) and default and isinstance(value, list):
        return tuple(_as_type_of(default[0], one, where) for one in value)
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not type(default):
        raise InvalidArgumentError(
            f"{where} must be of type {type(default).__name__}, got {value!r:.80}"
        )
    return value


def _check_length(hint: object, value: object, where: str) -> None:
    """Refuse a list that has not as many numbers as its field; ``tuple[float, ...]`` takes any number."""
    kinds = get_args(hint) if get_origin(hint) is tuple else ()
    if isinstance(value, tuple) and kinds and Ellipsis not in kinds and len(value) != len(kinds):
        raise InvalidArgumentError(f"{where} must be a list of {len(kinds)}, got {len(value)}")


def _check_names(given: Mapping[str, object], known: Mapping[str, object], where: str) -> None:
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise InvalidArgumentError(
                f"{where} has an unknown key {name!r:.80}: {hint}known are {', '.join(sorted(known))}"
            )
