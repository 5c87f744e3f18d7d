"""Help on one screen: what a command does and its own flags, a line each; --help-all shows every parameter."""

from __future__ import annotations

import ast
import inspect
import re
import shutil
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

_MAX_WIDTH = 100
_MAX_LINES = 29
_MAX_FLAG = 38
"""Columns for a flag and its values; more values stand in its text."""
_CUT = " ..."


class Flag(NamedTuple):
    """A row of the help."""

    name: str
    text: str
    group: str = ""


def overview(commands: Mapping[str, Callable[..., int]]) -> str:
    """Return the list of commands, a line each."""
    width = _width()
    indent = max(map(len, commands)) + 4
    rows = [f"  {name:<{indent - 2}}{_fit(_summary(command), width - indent)}" for name, command in commands.items()]
    return "\n".join(
        [
            "usage: curvescan COMMAND ...",
            "",
            *rows,
            "",
            "curvescan COMMAND -h        the flags of a command",
            "curvescan COMMAND --help-all  and every parameter of the matchers, the odometry and the map",
        ]
    )


def short_help(name: str, command: Callable[..., int]) -> str:
    """Return the help of a command on one screen: its purpose, its arguments and flags, a line each."""
    width = _width()
    positional, flags, n_groups = _arguments(command)
    head = " ".join(["usage: curvescan", name, *(f.name for f in positional), "[FLAGS]"])
    purpose = textwrap.wrap(_paragraph(command), width)
    foot = ["", "Defaults and full texts: --help-all."]
    if n_groups:
        foot[1] = "Every parameter, with defaults: --help-all; set them there or in a TOML file (--config)."
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
    texts = [text]
    if n_lines == 2 and text.endswith(_CUT):
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
    texts = _parameter_texts(inspect.getdoc(command) or "")
    hints = get_type_hints(command, include_extras=True)
    positional, flags, n_groups = [], [Flag("-h, --help-all", "This help; all of it.")], 0
    for name, parameter in inspect.signature(command).parameters.items():
        kind, metavar, is_flat = _unwrapped(hints[name])
        if is_dataclass(kind):
            if is_flat and not any(is_dataclass(_unwrapped(h)[0]) for h in get_type_hints(kind).values()):
                flags += _fields(kind, texts.get(name, ""))
            else:
                n_groups += 1
        elif parameter.kind is inspect.Parameter.POSITIONAL_ONLY:
            positional.append(Flag(metavar or name.upper(), texts.get(name, "")))
        else:
            text = texts.get(name, "")
            flag = f"--{name.replace('_', '-')} {_values(kind, metavar)}".rstrip()
            if len(flag) > _MAX_FLAG - 4:
                flag = f"--{name.replace('_', '-')} NAME"
                text = f"{re.split('[,.:;]', text)[0]}: {', '.join(map(str, get_args(kind)))}."
            is_needed = parameter.default is inspect.Parameter.empty
            flags.append(Flag(flag, text + (" Required." if is_needed else "")))
    return positional, flags, n_groups


def _fields(kind: Any, group: str) -> Iterator[Flag]:
    hints = get_type_hints(kind, include_extras=True)
    tree = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0]
    assert isinstance(tree, ast.ClassDef)
    texts = {
        a.target.id: str(b.value.value)
        for a, b in zip(tree.body, tree.body[1:], strict=False)
        if isinstance(a, ast.AnnAssign)
        and isinstance(a.target, ast.Name)
        and isinstance(b, ast.Expr)
        and isinstance(b.value, ast.Constant)
    }
    for field in fields(kind):
        inner, metavar, _ = _unwrapped(hints[field.name])
        flag = f"--{field.name.replace('_', '-')} {_values(inner, metavar)}".rstrip()
        yield Flag(flag, " ".join(texts.get(field.name, "").split()), group)


def _unwrapped(hint: Any) -> tuple[Any, str, bool]:
    """Return a type without None and annotations, its metavar, and whether its fields are flags without a prefix."""
    metavar, is_flat = "", False
    while True:
        if get_origin(hint) is Annotated:
            for extra in hint.__metadata__:
                metavar = metavar or getattr(extra, "metavar", None) or ""
                is_flat |= getattr(extra, "name", None) == ""
            hint = get_args(hint)[0]
        elif get_origin(hint) in (Union, UnionType):
            kinds = [kind for kind in get_args(hint) if kind is not NoneType]
            if len(kinds) != 1:
                return hint, metavar, is_flat
            hint = kinds[0]
        else:
            return hint, metavar, is_flat


def _values(kind: Any, metavar: str) -> str:
    if metavar or kind is bool:
        return metavar
    if get_origin(kind) is Literal:
        return "{" + ",".join(map(str, get_args(kind))) + "}"
    if get_origin(kind) is tuple:
        return _values(get_args(kind)[0], "") + " ..."
    return {int: "N", float: "NUMBER", str: "NAME"}.get(kind, "PATH")


def _parameter_texts(doc: str) -> dict[str, str]:
    """Return the descriptions of a numpydoc section Parameters, by name."""
    _, _, section = doc.partition("Parameters\n----------\n")
    texts: dict[str, list[str]] = {}
    name = ""
    for line in section.splitlines():
        if line and not line.startswith(" "):
            name = line.split(":")[0].strip()
            texts[name] = []
        elif name:
            texts[name].append(line.strip())
    return {name: " ".join(lines).strip() for name, lines in texts.items()}


def _paragraph(command: Callable[..., int]) -> str:
    return " ".join((inspect.getdoc(command) or "").split("\n\n")[0].split())


def _summary(command: Callable[..., int]) -> str:
    return _paragraph(command)


def _fit(text: str, width: int) -> str:
    """Return as much of a text as fits a line: whole sentences, else whole clauses, else whole words."""
    if len(text) <= width:
        return text
    ends = [m.start() for m in re.finditer(r"[.] |[:;] ", text) if m.start() < width]
    if ends:
        return text[: ends[0]] + "."
    ends = [m.start() for m in re.finditer(r", ", text) if width // 2 < m.start() < width]
    if ends:
        return text[: ends[-1]] + "."
    return textwrap.shorten(text, width, placeholder=_CUT)


def _width() -> int:
    return min(shutil.get_terminal_size((_MAX_WIDTH, 24)).columns, _MAX_WIDTH)
