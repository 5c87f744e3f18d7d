"""Sphinx configuration: `make docs` builds the site into docs/_build/html, offline, warnings as errors."""

from __future__ import annotations

import inspect
import warnings
from pathlib import Path
from typing import Any

import tyro
from docutils.nodes import SkipNode
from latex2mathml.converter import convert

import curvescan
from curvescan.cli.command_line import COMMANDS

DOCS = Path(__file__).parent
project = "curvescan"
author = "The curvescan developers"
copyright = "2026, the curvescan developers"  # noqa: A001 - Sphinx's name
release = version = curvescan.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
# these two are included by calibration/index.md
exclude_patterns = ["_build", "calibration/calibration.md", "calibration/sweep.md"]
templates_path = ["_templates"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

autosummary_generate = True
autodoc_typehints = "none"  # the docstrings give types with shapes and units
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True  # fields are described once, in their class

html_math_renderer = "mathml"  # browsers draw it themselves: no script from elsewhere, formulas offline too
html_theme = "pydata_sphinx_theme"
html_title = "curvescan"
html_static_path = ["_static"]
html_css_files = ["curvescan.css"]
html_show_sourcelink = False
html_sidebars = {"index": [], "start": []}  # no pages below them
html_theme_options = {
    "navigation_with_keys": False,
    "header_links_before_dropdown": 6,
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": ["theme-version"],
    "icon_links": [{"name": "Source", "url": "https://github.com/curvescan/curvescan", "icon": "fa-brands fa-github"}],
}

sphinx_gallery_conf = {
    "examples_dirs": ["../examples/gallery"],
    "gallery_dirs": ["gallery"],
    "filename_pattern": r"plot_",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "write_computation_times": False,
    "remove_config_comments": True,
    "min_reported_time": 60,
    "backreferences_dir": "reference/generated/backreferences",
    "doc_module": ("curvescan",),
}


def write_commands(_app: object) -> None:
    """Write reference/commands.md, and a page a command: its flags as tables, each with an anchor."""
    pages = DOCS / "reference" / "commands"
    pages.mkdir(exist_ok=True)
    for name, command in COMMANDS.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # tyro has no other way to list flags
            parser = tyro.extras.get_parser(command)
        purpose = (inspect.getdoc(command) or "").partition("\nParameters\n")[0].strip()
        tables = "".join(flag_table(group) for group in parser._action_groups)
        (pages / f"{name}.md").write_text(f"# curvescan {name}\n\n{purpose}\n\n{tables}", encoding="utf-8")
    listed = "\n".join(f"commands/{name}" for name in COMMANDS)
    text = (
        "# Commands\n\nEvery flag of each command; `curvescan COMMAND -h` shows the most used ones on one screen.\n\n"
        f"```{{toctree}}\n:maxdepth: 1\n\n{listed}\n```\n"
    )
    pages.with_suffix(".md").write_text(text, encoding="utf-8")


def flag_table(group: Any) -> str:
    """Return the flags of one group of arguments as a table in Markdown; empty where it has none but the help."""
    rows = []
    for action in group._group_actions:
        if action.dest == "help":
            continue
        flag = action.option_strings[0] if action.option_strings else str(action.metavar)
        values = str(action.metavar or "") if action.option_strings else ""
        text = " ".join((action.help or "").split()).replace("|", "\\|").replace("<", "&lt;")
        anchor = flag.strip("-").replace(".", "-").lower()
        rows.append(f'| <a id="{anchor}"></a>`{f"{flag} {values}".strip().replace("|", chr(92) + "|")}` | {text} |')
    if not rows:
        return ""
    title = str(group.title).removesuffix(" options").capitalize()
    return f"## {title}\n\n| argument | what it does |\n| --- | --- |\n" + "\n".join(rows) + "\n\n"


def write_formula(translator: Any, node: Any) -> None:
    """Write a formula as MathML."""
    is_alone = node.tagname == "math_block"
    formula = convert(node.astext(), display="block" if is_alone else "inline")
    translator.body.append(f"<div class='formula'>{formula}</div>" if is_alone else formula)
    raise SkipNode


def setup(app: Any) -> None:
    """Have the commands' help written when the build begins, and formulas drawn by browsers."""
    curvescan.warm_up()  # else a page of the gallery says how long its kernels took to compile
    app.connect("builder-inited", write_commands)
    app.add_html_math_renderer("mathml", (write_formula, None), (write_formula, None))
