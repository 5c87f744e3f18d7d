"""Help on one screen: what a command does and its own flags, a line each; --help-all shows every parameter."""

import inspect
import re
import shutil
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import tyro
from docstring_parser import parse, parse_from_object

_ArgConfig: Any = type(tyro.conf.arg())

_MAX_WIDTH = 100
_MAX_LINES = 29
_MAX_FLAG = 38  # columns for a flag and its values; more values stand in its text
_CUT = " ..."


class Flag(NamedTuple):
    """A row of the help."""

    name: str
    text: str
    group: str = ""
    has_choices: bool = False


def overview(commands: Mapping[str, Callable[..., int]]) -> str:
    """Return the list of commands, a line each."""
    width = _width()
    indent = max(map(len, commands)) + 4
    rows = [f"  {name:<{indent - 2}}{_fit(_paragraph(command), width - indent)}" for name, command in commands.items()]
    return "\n".join(
        [
            "usage: curvescan COMMAND ...\n",
            *rows,
            "\ncurvescan COMMAND -h        the flags of a command",
            "curvescan COMMAND --help-all  and every parameter of the matchers, the odometry and the map",
        ]
    )


def short_help(name: str, command: Callable[..., int]) -> str:
    """Return the help of a command on one screen: its purpose, its arguments and flags, a line each."""
    width = _width()
    positional, flags, n_groups = _arguments(command)
    head = " ".join(["usage: curvescan", name, *(f.name for f in positional), "[FLAGS]"])
    purpose = textwrap.wrap(_paragraph(command), width)
    more = "; set them there or in a TOML file (--config)" * any(f.name.startswith("--config ") for f in flags)
    foot = [
        "",
        f"Every parameter, with defaults: --help-all{more}." if n_groups else "Defaults and full texts: --help-all.",
    ]
    n_left = _MAX_LINES - len(purpose) - len(foot) - 4
    if len(positional) + len(flags) > n_left:
        flags = list(_merged(flags))
    indent = min(max(len(f.name) for f in (*positional, *flags)) + 4, _MAX_FLAG)
    n_spare = n_left - len(positional) - len(flags)
    lines: list[str] = []
    for flag in (*positional, *flags):
        rows = _row(flag, indent, width, n_lines=2 if n_spare > 0 else 1)
        n_spare -= len(rows) - 1
        lines += rows
    return "\n".join([head, "", *purpose, "", *lines, *foot])


def _row(flag: Flag, indent: int, width: int, *, n_lines: int) -> list[str]:
    """Return the lines of a flag: one, or two where the text takes them and there is room."""
    text = _fit(flag.text, width - indent)
    texts = textwrap.wrap(flag.text, width - indent, break_on_hyphens=False) if flag.has_choices else [text]
    if not flag.has_choices and n_lines == 2 and text.endswith(_CUT):
        texts = textwrap.wrap(_fit(flag.text, 2 * (width - indent) - 12), width - indent)
    names = [flag.name, *[""] * (len(texts) - 1)]
    return [f"  {n:<{indent - 2}}{t}".rstrip() for n, t in zip(names, texts, strict=True)]


def _merged(flags: list[Flag]) -> Iterator[Flag]:
    """Yield the flags, those of a group in one row."""
    groups: dict[str, list[str]] = {}
    for flag in flags:
        if flag.group:
            groups.setdefault(flag.group, []).append(flag.name.split()[0])
        else:
            yield flag
    for group, names in groups.items():
        yield Flag(", ".join(names[:2]) + ", ...", group)


def _arguments(command: Callable[..., int]) -> tuple[list[Flag], list[Flag], int]:
    """Return the positional arguments, the flags, and how many groups of parameters are left to --help-all."""
    texts = {p.arg_name: p.description or "" for p in parse(inspect.getdoc(command) or "").params}
    hints = get_type_hints(command, include_extras=True)
    positional, flags, n_groups = [], [Flag("-h, --help-all", "This help; every flag with its full text.")], 0
    for name, parameter in inspect.signature(command).parameters.items():
        is_needed, text = parameter.default is inspect.Parameter.empty, texts.get(name, "")
        if parameter.kind is inspect.Parameter.POSITIONAL_ONLY:
            _, found = _unwrapped(hints[name])
            word = (found.metavar or name.upper()).strip("[]")
            positional.append(Flag(word if is_needed else f"[{word}]", text or found.help))
        else:
            more, n_more = _flags(name, hints[name], text, needed=" Required." * is_needed)
            flags, n_groups = [*flags, *more], n_groups + n_more
    return positional, flags, n_groups


def _flags(name: str, hint: Any, text: str, *, group: str = "", needed: str = "") -> tuple[list[Flag], int]:
    """Return the flags of an argument or of a record of flags, and how many groups of parameters it leaves out."""
    kind, found = _unwrapped(hint)
    if is_dataclass(kind):
        if not found.is_flat:
            return [], 1
        hints = get_type_hints(kind, include_extras=True)
        docs = {p.arg_name: p.description or "" for p in parse_from_object(kind).params}
        parts = [_flags(f.name, hints[f.name], docs.get(f.name, ""), group=found.help) for f in fields(kind)]
        return [flag for flags, _ in parts for flag in flags], sum(n for _, n in parts)
    name, text = f"--{name.replace('_', '-')}", (text or found.help) + needed
    flag = f"{name} {_values(kind, found.metavar)}".rstrip()
    has_choices = len(flag) > _MAX_FLAG - 4
    if has_choices:
        flag, text = f"{name} NAME", f"{re.split('[,.:;]', text)[0]}: {', '.join(map(str, get_args(kind)))}."
    return [Flag(flag, " ".join(text.split()), group, has_choices)], 0


class _Extras(NamedTuple):
    """What annotations of an argument say: its metavar, its text, and whether its fields are flags without a prefix."""

    metavar: str = ""
    help: str = ""
    is_flat: bool = False


def _unwrapped(hint: Any) -> tuple[Any, _Extras]:
    """Return a type without None, and what its annotations say."""
    found = _Extras()
    while True:
        if get_origin(hint) is Annotated:
            for extra in hint.__metadata__:
                if isinstance(extra, _ArgConfig):
                    metavar, text = found.metavar or extra.metavar or "", found.help or str(extra.help or "")
                    found = _Extras(metavar, text, found.is_flat or extra.name == "")
            hint = get_args(hint)[0]
        elif get_origin(hint) in (Union, UnionType):
            kinds = [kind for kind in get_args(hint) if kind is not NoneType]
            if len(kinds) != 1:
                return hint, found
            hint = kinds[0]
        else:
            return hint, found


def _values(kind: Any, metavar: str) -> str:
    if metavar or kind is bool:
        return metavar
    if get_origin(kind) is Literal:
        return "{" + ",".join(map(str, get_args(kind))) + "}"
    if get_origin(kind) is tuple:
        return _values(get_args(kind)[0], "") + " ..."
    return {int: "N", float: "NUMBER", str: "NAME"}.get(kind, "PATH")


def _paragraph(command: Callable[..., int]) -> str:
    return " ".join((inspect.getdoc(command) or "").split("\n\n")[0].split())


def _fit(text: str, width: int) -> str:
    """Return as much of a text as fits a line: whole sentences, else whole clauses, else whole words."""
    if len(text) <= width:
        return text
    ends = [m.start() for m in re.finditer(r"[.] |[:;] ", text) if m.start() < width]
    if ends:
        return text[: ends[-1]] + "."
    ends = [m.start() for m in re.finditer(r", ", text) if width // 2 < m.start() < width]
    if ends:
        return text[: ends[-1]] + "."
    return textwrap.shorten(text, width, placeholder=_CUT)


def _width() -> int:
    return min(shutil.get_terminal_size((_MAX_WIDTH, 24)).columns, _MAX_WIDTH)
