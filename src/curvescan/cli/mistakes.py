"""Mistakes in a command line, a sentence each: tyro frames them, and names the help of another command."""

import difflib
import io
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress

from curvescan.io.files.lines import printable

_KINDS = {"FLOAT": "a number", "float": "a number", "INT": "a whole number", "int": "a whole number"}
_VALUES = r"instantiated from \[(.+?)\]|parse arguments \[(.+?)\]|arguments: \[(.+?)\]|(?:float|base 10): ('.*')"
_LIKE = 0.7  # how like a flag another one is that may have been meant
_MAX_SENTENCE = 1_000


@contextmanager
def mistakes_in_sentences(arguments: Sequence[str], show_help: Callable[[], object]) -> Iterator[None]:
    """Print what tyro finds wrong with a command and its arguments in a sentence; show_help: prints all its flags."""
    text, flags = io.StringIO(), io.StringIO()
    try:
        with redirect_stderr(text):
            yield
    except SystemExit as end:
        if end.code:
            with redirect_stdout(flags), redirect_stderr(io.StringIO()), suppress(SystemExit):
                show_help()
            sentence = printable(_sentence(text.getvalue(), arguments, flags.getvalue()), _MAX_SENTENCE)
            text = io.StringIO(f"curvescan: {sentence}; help: curvescan {arguments[0]} -h\n")
        raise
    finally:
        print(text.getvalue(), end="", file=sys.stderr)


def _sentence(framed: str, arguments: Sequence[str], help_text: str) -> str:
    """Return what stands in tyro's frame above its first rule; in our own words, where tyro's are those of Python."""
    rows = [row.strip("│ ") for row in framed.splitlines()[1 if framed.startswith("╭") else 2 :]]
    n_rows = next((k for k, row in enumerate(rows) if re.match("-----|──|╰", row)), len(rows))
    said = " ".join(row for row in rows[:n_rows] if row).replace(" (required)", "").removesuffix(".")
    flags, found = re.findall(r"--(\w[\w.-]*)", help_text), re.match(r"Unrecognized .*?options: (\S+)", said)
    # tyro may miss the argument that an unknown flag took for its value
    words = [word for word in arguments if word.startswith("--")] + ([found[1]] if found else [])
    for word in words:
        name = word.lstrip("-").partition("=")[0].replace("_", "-")
        if name not in flags:
            near = difflib.get_close_matches(name, flags, 1, _LIKE)
            return f"{arguments[0]} does not take {word!r}" + "".join(f": did you mean '--{one}'?" for one in near)
    if found := re.match(r"(?:Error parsing |Missing value for argument ')([\w.-]+)[':]", said):
        flag, values = found[1], re.search(_VALUES, said)
        if flag.startswith("__tyro"):  # a value that a configuration refuses
            return said[found.end() :].strip()
        shown = re.search(rf"^[│ ]*{flag} (?:\{{None\}}\|)?(\S.*?)(?:  |[│ ]*$)", help_text, re.M)
        kind = shown[1] if shown else next((kind for kind in ("float", "int") if kind in said), "")
        got = next(filter(None, values.groups())).replace("', '", " ") if values else "nothing"
        return f"{flag} takes {_KINDS.get(kind, kind)}, got {got}" if kind else said
    return said
