"""-h fits one screen; --help-all and the TOML file have the rest."""

from __future__ import annotations

import pytest

from curvescan.cli.command_line import COMMANDS, run
from curvescan.cli.console import with_flags


@pytest.mark.parametrize("flag", ["-h", "--help"])
@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_every_command_fits_one_screen(name, flag, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert run([name, flag]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"usage: curvescan {name}")
    assert 8 < len(lines) <= 30
    assert max(map(len, lines)) <= 100
    assert any("--help-all" in line for line in lines)
    # a text for every flag
    rows = [line for line in lines if line.startswith("  -")]
    assert rows
    assert all(len(row.split("  ")) > 2 and row.split("  ")[-1].strip() for row in rows)


@pytest.mark.parametrize("name", ["odometry", "match", "demo"])
def test_every_parameter_stands_behind_help_all(name, capsys):
    with pytest.raises(SystemExit) as done:
        run([name, "--help-all"])
    assert done.value.code == 0
    text = capsys.readouterr().out
    assert "--curvescan.refinement." in text
    assert "--cfsma.landmarks.min-curvature" in text
    assert len(text.splitlines()) > 200


def test_every_flag_of_a_command_is_in_its_help(capsys):
    run(["odometry", "-h"])
    text = capsys.readouterr().out
    for flag in ("--out", "--method", "--export", "--odometry-prior", "--clockwise", "--config"):
        assert flag in text
    with pytest.raises(SystemExit):
        run(["odometry", "--help-all"])
    text = capsys.readouterr().out
    for method in ("curvescan", "cfsma", "plicp"):
        assert method in text


def test_an_argument_that_may_be_left_out_stands_in_brackets(capsys):
    run(["view", "-h"])
    assert "usage: curvescan view RESULTS [OTHER] [FLAGS]" in capsys.readouterr().out


def test_the_list_of_commands_fits_one_screen(capsys):
    assert run(["-h"]) == 0
    text = capsys.readouterr().out
    assert all(f"  {name} " in text for name in COMMANDS)
    assert len(text.splitlines()) <= 30
    assert max(map(len, text.splitlines())) <= 100


def test_the_occupancy_map_is_configured_from_a_file_too(tmp_path, capsys):
    import json

    import curvescan as cs

    cs.write_log(tmp_path / "log.npz", cs.simulate("office", n_scans=4, seed=1))
    (tmp_path / "my.toml").write_text("[map]\nresolution = 0.2\n")
    command = ["odometry", str(tmp_path / "log.npz"), "--out", str(tmp_path / "o")]
    assert run([*command, "--config", str(tmp_path / "my.toml")]) == 0
    assert json.loads((tmp_path / "o" / "run.json").read_text())["occupancy"]["resolution"] == 0.2


@pytest.mark.parametrize(
    ("message", "printed"),
    [
        ("choose one with topic='/front/scan'", "choose one with --topic /front/scan"),
        (
            "give clockwise=True if it does, or leave odometry_prior=True out",
            "give --clockwise if it does, or leave --odometry-prior out",
        ),
        ("try range_max=8.1", "try --range-max 8.1"),
        ("try ignore_beams=(2, 3)", "try --ignore-beams 2 3"),
        ("try upside_down=False", "try --upright"),
        ("SLAM with map= continues it", "`curvescan slam --map` continues it"),
        ("range_max must be positive, got 0", "range_max must be positive, got 0"),
    ],
)
def test_messages_of_the_library_name_flags_on_the_command_line(message, printed):
    assert with_flags(message) == printed


def test_an_issue_names_the_argument_and_the_option():
    from curvescan.diagnostics.issues import Issue, Remedy

    for option, argument, remedy in (
        ("--range-max 8.1", "range_max=8.1", Remedy("range_max", 8.1)),
        ("--ignore-beams 2 3", "ignore_beams=(2, 3)", Remedy("ignore_beams", (2, 3))),
        ("--drop-stale", "drop_stale=True", Remedy("drop_stale", True)),
        ("--upright", "upside_down=False", Remedy("upside_down", False)),
        ("", "", None),
    ):
        issue = Issue(topic="beams", kind="k", what="w", remedy=remedy)
        assert issue.argument == argument
        assert with_flags(argument) == option
