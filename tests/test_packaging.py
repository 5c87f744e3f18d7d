"""What packages the project agrees with pyproject.toml and the Makefile."""

from __future__ import annotations

import re
import tomllib

import pytest

from tests.conftest import ROOT

yaml = pytest.importorskip("yaml")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def test_the_conda_recipe_needs_what_the_package_needs():
    text = (ROOT / "recipe" / "meta.yaml").read_text("utf-8")
    text = re.sub(r"\{%.*?%\}", "", text)
    recipe = yaml.safe_load(text.replace("{{ version }}", "0.1.0").replace("{{ PYTHON }}", "python"))
    names = {"docstring-parser": "docstring_parser", "matplotlib": "matplotlib-base"}
    wanted = {"python " + PROJECT["requires-python"]}
    for requirement in PROJECT["dependencies"]:
        name, bounds = re.fullmatch(r"([\w-]+)(.*)", requirement).groups()
        wanted.add(f"{names.get(name, name)} {bounds}")
    assert set(recipe["requirements"]["run"]) == wanted
    command, home = recipe["build"]["entry_points"][0].split(" = ")
    assert PROJECT["scripts"] == {command: home}


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_call_targets_that_there_are(path):
    workflow = yaml.safe_load(path.read_text("utf-8"))
    steps = [step for job in workflow["jobs"].values() for step in job.get("steps", ())]
    commands = [step["run"] for step in steps if "run" in step]
    assert all(command.startswith("make ") for command in commands)
    assert {command.split()[1] for command in commands} <= TARGETS
    used = [job["uses"] for job in workflow["jobs"].values() if "uses" in job]
    assert all((ROOT / file).is_file() for file in used)


def test_pythons_are_those_that_are_tried():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "wheel.yml").read_text("utf-8"))
    tried = set(workflow["jobs"]["run"]["strategy"]["matrix"]["python"])
    prefix = "Programming Language :: Python :: 3."
    assert {f"3.{c.removeprefix(prefix)}" for c in PROJECT["classifiers"] if c.startswith(prefix)} == tried


def test_the_image_has_extras_that_there_are():
    text = (ROOT / "Dockerfile").read_text("utf-8")
    [extras] = re.findall(r"\.whl\)\[([\w,]+)\]", text)
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    # heavy ones are asked for by name alone
    assert "ray" not in extras
    assert not any("ray" in word for word in PROJECT["optional-dependencies"]["dev"])
