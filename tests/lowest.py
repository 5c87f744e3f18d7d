"""Constraints for pip: every dependency at the lowest version allowed; `make test-lowest` uses them."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path


def lowest(requirements: list[str]) -> list[str]:
    """Return ``name==version`` for each ``name>=version`` of the requirements."""
    found = (re.match(r"([\w-]+)(?:\[[^]]*\])?>=([\w.]+)", one) for one in requirements)
    return [f"{match[1]}=={match[2]}" for match in found if match]


if __name__ == "__main__":
    project = tomllib.loads(Path("pyproject.toml").read_text())["project"]
    print("\n".join(lowest(project["dependencies"])))
