"""Configurations from what a user gives: an instance, a mapping of some of its fields, or nothing."""

import dataclasses
import difflib
import numbers
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib.resources import files
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

from curvescan.errors import InvalidArgumentError

Config = TypeVar("Config")
_T = TypeVar("_T")


def as_config(
    given: Config | Mapping[str, Any] | None, default: Config, *, name: str = "config", hint: str = ""
) -> Config:
    """Return the configuration that an argument stands for. Raises InvalidArgumentError."""
    if given is None:
        return default
    if isinstance(given, type(default)):
        return given
    kind = type(default).__name__
    if not isinstance(given, Mapping):
        got = f"the class {given.__name__}" if isinstance(given, type) else type(given).__name__
        article = "an" if kind[:1] in "AEIO" else "a"
        raise InvalidArgumentError(
            f"{name} must be {article} {kind}, a mapping of its fields or None, got {got}"
            + (f": {hint}" if hint else "")
        )
    return changed(default, given, name)


def changed(default: Config, given: Mapping[str, Any], where: str) -> Config:
    """Return a configuration with the fields of a mapping replaced, nested ones field by field."""
    if not isinstance(given, Mapping):
        raise InvalidArgumentError(f"{where} must be a table, got {given!r:.80}")
    values = {f.name: getattr(default, f.name) for f in fields(cast(Any, default))}
    check_names(given, values, where)
    hints = get_type_hints(type(default))
    for name, value in given.items():
        place = f"{where[:-1]}.{name}]" if where.endswith("]") else f"{where}[{name!r}]"
        known = values[name]
        if is_dataclass(known) and not isinstance(value, type(known)):
            values[name] = changed(known, value, place)
        elif not is_dataclass(known):
            values[name] = _as_type_of(known, value, f"{where} {name}")
            _check_length(hints[name], values[name], f"{where} {name}")
        else:
            values[name] = value
    try:
        return type(default)(**values)
    except InvalidArgumentError as error:
        raise InvalidArgumentError(f"{where}: {error}") from error


def require_parts(config: Any) -> None:
    """Raise InvalidArgumentError where a part of a configuration is no instance of the class that it has there."""
    for name, kind in ((f.name, f.default_factory) for f in fields(config)):
        value = getattr(config, name)
        if isinstance(kind, type) and not isinstance(value, kind):
            raise InvalidArgumentError(
                f"{name} must be a {kind.__name__}, got {value!r:.80}: give a mapping of the fields that differ where "
                f"the configuration is used, config={{{name!r}: {{...}}}}"
            )


def nearest(name: object, known: Iterable[str]) -> str:
    """Return ``"did you mean 'x'? "`` where a known name is like the given one, else an empty string."""
    near = difflib.get_close_matches(str(name), list(known), n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}? " if near else ""


def counted(count: int, noun: str) -> str:
    """Return a number with its noun, which has an s but after 1: ``"1 scan"``, ``"2,000 scans"``."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def look_up(table: Mapping[str, _T], name: object, what: str) -> _T:
    """Return an entry of a table by its name; a name that it does not have is an error with the nearest one."""
    if isinstance(name, str) and name in table:
        return table[name]
    raise InvalidArgumentError(f"unknown {what} {name!r:.80}: {nearest(name, table)}known are {', '.join(table)}")


def check_names(given: Mapping[str, Any], known: Mapping[str, Any], where: str) -> None:
    """Raise InvalidArgumentError for the first key that is not among the known names, with the nearest of them."""
    for name in given:
        if name not in known:
            raise InvalidArgumentError(
                f"{where} has an unknown key {name!r:.80}: {nearest(name, known)}known are {', '.join(sorted(known))}"
            )


def _as_type_of(default: object, value: object, where: str) -> object:
    """Return a value as the type that a field has, where it is one: NumPy's numbers, and a list for a tuple."""
    if isinstance(default, tuple) and default and isinstance(value, list | tuple):
        return tuple(_as_type_of(default[0], one, where) for one in value)
    is_bool = isinstance(value, bool)
    if isinstance(default, float) and isinstance(value, numbers.Real) and not is_bool:
        return float(value)
    if type(default) is int and isinstance(value, numbers.Integral) and not is_bool:
        return int(value)
    if type(value) is not type(default):
        raise InvalidArgumentError(f"{where} must be of type {type(default).__name__}, got {value!r:.80}")
    return value


def _check_length(hint: object, value: object, where: str) -> None:
    """Refuse a list that has not as many numbers as its field; ``tuple[float, ...]`` takes any number."""
    kinds = get_args(hint) if get_origin(hint) is tuple else ()
    if isinstance(value, tuple) and kinds and Ellipsis not in kinds and len(value) != len(kinds):
        raise InvalidArgumentError(f"{where} must be a list of {len(kinds)}, got {len(value)}")


def as_plain(value: object) -> object:
    """Return a configuration as dictionaries, lists, numbers and strings."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: as_plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, Mapping):
        return {str(key): as_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [as_plain(item) for item in value]
    return value


def shipped_table(package: str, name: str) -> dict[str, Any]:
    """Return a TOML file that stands beside the modules of a package."""
    return tomllib.loads(files(package).joinpath(name).read_text("utf-8"))
