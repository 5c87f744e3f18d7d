"""The version of the package, which results are marked with, and the commit that it was made of."""

import re
from pathlib import Path

__version__ = "0.1.0"

COMMIT_FILE = "_commit.txt"
"""Written into the sdist and the wheel by hatch_build.py; a tree has none, and its .git is read."""


def commit() -> str | None:
    """Return the commit that this package was built from, or that its tree is at; None where neither says so."""
    package = Path(__file__).parent
    found = _text(package / COMMIT_FILE)
    # a package that is installed may lie in somebody else's repository
    if not found and package.parent.name == "src":
        found = _head(package.parent.parent / ".git")
    return found if re.fullmatch(r"[0-9a-f]{40}([0-9a-f]{24})?", found) else None


def described() -> str:
    """Return the version, with the commit where it is known."""
    known = commit()
    return f"curvescan {__version__}" + (f" (commit {known[:12]})" if known else "")


def _head(git: Path) -> str:
    """Return the commit that a repository is at, as its files say; empty where they do not."""
    if git.is_file():  # a worktree, or a submodule
        git = git.parent / _text(git).removeprefix("gitdir:").strip()
    head = _text(git / "HEAD")
    if not head.startswith("ref:"):
        return head
    name = head.removeprefix("ref:").strip()
    common = git / (_text(git / "commondir") or ".")
    packed = re.search(rf"^(\w+) {re.escape(name)}$", _text(common / "packed-refs"), re.MULTILINE)
    return _text(git / name) or _text(common / name) or (packed[1] if packed else "")


def _text(path: Path) -> str:
    try:
        return path.read_text("utf-8").strip()
    except (OSError, UnicodeDecodeError):
        return ""
