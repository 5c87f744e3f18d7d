"""What packages the project agrees with pyproject.toml and the Makefile."""

from __future__ import annotations

import json
import re
import tomllib

import pytest
from packaging.requirements import Requirement

from curvescan import __version__
from tests.conftest import ROOT

yaml = pytest.importorskip("yaml")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def test_the_conda_recipe_needs_what_the_package_needs():
    text = (ROOT / "recipe" / "meta.yaml").read_text("utf-8")
    text = re.sub(r"\{%.*?%\}", "", text)
    recipe = yaml.safe_load(text.replace("{{ version }}", "0.1.0").replace("{{ PYTHON }}", "python"))
    names = {"docstring-parser": "docstring_parser", "matplotlib": "matplotlib-base", "ruamel-yaml": "ruamel.yaml"}
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
    assert set(workflow["jobs"]["kernels"]["strategy"]["matrix"]["python"]) == tried
    prefix = "Programming Language :: Python :: 3."
    assert {f"3.{c.removeprefix(prefix)}" for c in PROJECT["classifiers"] if c.startswith(prefix)} == tried


def test_the_image_has_extras_that_there_are():
    text = (ROOT / "Dockerfile").read_text("utf-8")
    [extras] = re.findall(r"\.whl\)\[([\w,]+)\]", text)
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    # heavy ones are asked for by name alone
    assert "ray" not in extras
    assert not any("ray" in word for word in PROJECT["optional-dependencies"]["dev"])


def test_the_image_has_a_version_of_each_library_that_the_package_allows():
    text = (ROOT / "Dockerfile").read_text("utf-8")
    assert "COPY constraints.txt" in text
    assert '--constraint "$CONSTRAINTS"' in text
    lines = (ROOT / "constraints.txt").read_text("utf-8").splitlines()
    pins = dict(line.split("==") for line in lines if not line.startswith("#"))
    assert all(re.fullmatch(r"[\w.]+", version) for version in pins.values())
    [extras] = re.findall(r"\.whl\)\[([\w,]+)\]", text)
    asked = [*PROJECT["dependencies"], *(one for e in extras.split(",") for one in PROJECT["optional-dependencies"][e])]
    for requirement in map(Requirement, asked):
        assert pins[requirement.name.lower()] in requirement.specifier, requirement


def test_the_citation_is_complete_and_says_what_zenodo_is_told():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    zenodo = json.loads((ROOT / ".zenodo.json").read_text("utf-8"))
    # required by version 1.2.0 of the format, and what a reader looks for
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "abstract", "repository-code", "references"} <= citation.keys()
    assert citation["version"] == zenodo["version"] == __version__
    assert citation["license"] == zenodo["license"] == PROJECT["license"]
    assert citation["repository-code"] == PROJECT["urls"]["Homepage"]
    for name in ("title", "keywords"):
        assert citation[name] == zenodo[name]
    assert f"<p>{citation['abstract']}</p>" == zenodo["description"]
    assert [one["name"] for one in zenodo["creators"]] == [one["name"] for one in citation["authors"]]
    # the fields that Zenodo refuses an upload without
    assert zenodo["upload_type"] == "software"
    [paper] = citation["references"]
    assert [f"{one['family-names']}, {one['given-names']}" for one in paper["authors"]] == re.findall(
        r"\w[\w-]+, \w\.", zenodo["references"][0].split("(")[0]
    )
