"""`uavmap simulate`, with localization, and `uavmap strategies`, in process."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from missions.lab.localization.localization_run import METHODS
from missions.planning.stepwise import EXPLORERS
from missions.planning.sweep.strategies import ON_PATHS
from uavmap.lab.commands import runs, simulate
from uavmap.lab.trials import Trial, trials
from uavmap.ui.cli import main

KEYS = {"makespan", "lower_bound", "bound", "bound_held", "moves", "tree_depth"}
TIMES = {"wall_s", "lower_bound_wall_s"}


def printed(capsys: pytest.CaptureFixture[str], *arguments: object) -> Any:
    assert main([str(a) for a in arguments]) == 0
    return json.loads(capsys.readouterr().out)


def row_file(folder: Path) -> Path:
    """Write a row of four cells and a square of four, with a key that is unknown."""
    rois = [
        {"start": [0, 0], "cells": [[i, 0] for i in range(4)], "seed": 9},
        {"start": [0, 0], "cells": [[0, 0], [1, 0], [0, 1], [1, 1]]},
    ]
    path = folder / "rois.json"
    path.write_text(json.dumps({"rois": rois}))
    return path


def test_figures_agree_with_a_calculation_by_hand(tmp_path, capsys):
    values = printed(capsys, "simulate", "--roi", row_file(tmp_path), "--json")
    assert set(values) == {"rois", "means"}
    row, square = values["rois"]
    assert set(row) == KEYS | TIMES
    assert (row["makespan"], row["lower_bound"], row["bound"]) == (6.0, 6.0, 6.0)
    assert (row["bound_held"], row["moves"], row["tree_depth"]) == (True, 6, 3)
    assert (square["makespan"], square["lower_bound"], square["moves"]) == (6.0, 4.0, 6)
    means = values["means"]
    assert (means["makespan"], means["lower_bound"], means["ratio"]) == (6.0, 5.0, 1.2)
    assert means["bound_held"] is True


def test_drift_across_a_row_costs_less_than_along_it(tmp_path, capsys):
    """Across the drift every step costs 1 / sqrt(1 - 0.36) = 1.25; along it 1.5625 on average."""
    roi = row_file(tmp_path)
    across, along = (
        printed(capsys, "simulate", "--roi", roi, "--drift", f"0.6,{towards}", "--json")["rois"][0]
        for towards in (0, 90)
    )
    assert (across["makespan"], across["lower_bound"]) == (7.5, 7.5)
    assert along["makespan"] == pytest.approx(6 * 1.5625)
    assert along["bound"] == pytest.approx(6 * 1.5625)
    assert along["bound_held"]
    fast = printed(capsys, "simulate", "--roi", roi, "--speed", "2", "--json")["rois"][0]
    assert fast["makespan"] == 3.0


@pytest.mark.parametrize("comms", ["shared", "meeting"])
def test_several_strategies_repeat_on_grown_rois(capsys, comms):
    arguments = ["simulate", "--generate", "ragged", "--cells", 40, "--count", 3, "--robots", 3]
    arguments += ["--comms", comms, "--strategy", "rdfs,rdfs-paper", "--strategy", "rdfs", "--json"]
    once, again = (printed(capsys, *arguments) for _ in range(2))
    assert list(once) == ["rdfs", "rdfs-paper"]
    for name, values in once.items():
        assert len(values["rois"]) == 3
        for row in values["rois"]:
            assert row["makespan"] >= row["lower_bound"]
            promised = name == "rdfs" and comms == "shared"
            assert row["bound_held"] is (True if promised else None)
        for row in (*values["rois"], *again[name]["rois"], values["means"], again[name]["means"]):
            assert all(row.pop(key) > 0.0 for key in TIMES)
    assert once["rdfs-paper"]["means"]["bound"] is None
    assert once == again


def test_radio_is_stated_and_filmed_and_bounds_are_not(tmp_path, capsys):
    arguments = ["simulate", "--roi", "eden:40:3", "--robots", 3, "--comms", "range:3,loss:0.5"]
    once, again, other = (
        printed(capsys, *arguments, "--json", "--strategy", "rdfs,greedy", "--seed", seed)
        for seed in (1, 1, 2)
    )
    for name in ("rdfs", "greedy"):
        assert once[name]["comms"] == "range:3,loss:0.5"
        assert once[name]["means"]["bound"] is None
    moves = [
        [values[name]["rois"][0]["moves"] for name in values] for values in (once, again, other)
    ]
    assert moves[0] == moves[1] != moves[2]
    film = tmp_path / "film.gif"
    assert main([str(a) for a in (*arguments, "--animate", film)]) == 0
    assert "eden:40:3, 3 robots, range:3,loss:0.5" in capsys.readouterr().out
    assert film.read_bytes().startswith(b"GIF8")


def test_table_names_strategies_and_bounds(capsys):
    assert main(["simulate", "--generate", "thin", "--cells", "20", "--count", "2"]) == 0
    shown = capsys.readouterr().out
    words_of_time = "the lower bound of a ROI took another 0."
    for words in ("means of 2 ROIs, 1 robot", "rdfs", "T / LB", "yes", words_of_time):
        assert words in shown


def test_figures_are_written_once(tmp_path, capsys):
    out = tmp_path / "new" / "out"
    arguments = ["simulate", "--roi", "eden:9:1", "--json", "--out", str(out)]
    assert main(arguments) == 0
    assert (out / "summary.json").read_text() == capsys.readouterr().out
    assert main(arguments) == 2
    assert "choose another" in capsys.readouterr().err


def test_interrupt_prints_the_finished_trials(monkeypatch, capsys):
    def interrupted(*arguments: Any) -> Iterator[Trial]:
        for number, trial in enumerate(trials(*arguments)):
            if number == 2:
                raise KeyboardInterrupt
            yield trial

    monkeypatch.setattr(simulate, "trials", interrupted)
    monkeypatch.setattr(runs, "_REPORT_S", 0.0)
    code = main(["simulate", "--generate", "eden", "--cells", "9", "--count", "5", "--json"])
    streams = capsys.readouterr()
    assert code == 130
    assert len(json.loads(streams.out)["rois"]) == 2
    assert "interrupted after 2 of 5 runs" in streams.err
    assert "1 of 5 runs" in streams.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--generate", "edn"], "choose one of eden"),
        (["--generate", "eden", "--start", "1,2"], "--start is for --roi"),
        (["--roi", "eden:9:1", "--cells", "9"], "--cells is for --generate"),
        (["--roi", "nowhere.json"], "cannot be read"),
        (["--roi", "eden:9:1", "--strategy", "rdfs,dfs"], "'dfs' is not known"),
        (["--roi", "eden:9:1", "--strategy", ""], "'' is not known"),
        (["--roi", "eden:9:1", "--drift", "1,0"], "do not keep up"),
        (["--roi", "eden:9:1", "--drift", "nan,0"], "V,DEG"),
        (["--roi", "eden:9:1", "--drift", "0.1"], "V,DEG"),
        (["--roi", "x.json", "--start", "here"], "LAT,LON"),
        (["--roi", "eden:9:1", "--comms", "radio"], "'radio' is none of shared, free, meeting"),
        (["--roi", "eden:9:1", "--comms", "free,loss:2"], "--comms free,loss:2: loss:2 is above 1"),
        (["--roi", "eden:9:1", "--comms", "free,apart:1-2:3"], "robot 3 is none of 1 to 1"),
        (["--roi", "eden:9:1", "--comms", "range:3", "--seed", "2"], "or for --comms with a loss"),
        (
            ["--roi", "eden:9:1", "--comms", "range:3", "--strategy", "swath"],
            "uavmap fly MISSION --sim --comms HOW",
        ),
        (["--roi", "eden:9:1", "--out", ""], "choose another"),
        (["--roi", "eden:9:1", "--out", __file__], "choose another"),
        (["--roi", "eden:9:1", "--out", f"{__file__}/new"], "cannot be made: Not a directory"),
    ],
)
def test_wrong_arguments_are_refused_in_a_line(arguments, words, capsys):
    assert main(["simulate", *arguments]) == 2
    streams = capsys.readouterr()
    assert streams.out == ""
    (line,) = streams.err.splitlines()
    assert line.startswith("uavmap: ")
    assert words in line


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--roi", "a", "--generate", "eden"],
        ["--generate", "eden", "--robots", "0"],
        ["--generate", "eden", "--cells", "nan"],
        ["--generate", "eden", "--speed", "inf"],
    ],
)
def test_missing_arguments_show_the_usage(arguments, capsys):
    with pytest.raises(SystemExit) as left:
        main(["simulate", *arguments])
    assert left.value.code == 2
    assert "usage: uavmap simulate" in capsys.readouterr().err


def test_strategies_are_listed(capsys):
    listed = printed(capsys, "strategies", "--json")
    assert [entry["name"] for entry in listed] == [*EXPLORERS, *ON_PATHS]
    assert all(set(entry) == {"name", "guarantee", "source", "when"} for entry in listed)
    assert main(["strategies"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in (*EXPLORERS, *ON_PATHS))


# --- localization ---------------------------------------------------------------------------------
def figures(capsys: pytest.CaptureFixture[str], *options: str) -> Any:
    return printed(capsys, "simulate", *options, "--json")


def test_methods_of_localization_run_on_grown_rois(capsys, tmp_path):
    names = ",".join(METHODS)
    options = ("--generate", "ragged", "--cells", "30", "--count", "2", "--localize", names)
    found = figures(capsys, *options, "--trials", "8", "--out", str(tmp_path))
    assert json.loads((tmp_path / "summary.json").read_text()) == found
    assert list(found) == list(METHODS)
    for name, method in METHODS.items():
        assert [row["roi"] for row in found[name]["rois"]] == ["ragged:30:1", "ragged:30:2"]
        for row in found[name]["rois"]:
            assert row["right"] == row["confidence_mean"] == 1.0
            assert row["trials"] == 8
            assert row["bound"] == (None if method.bound is None else method.bound(30))
        assert found[name]["means"]["bound_held"] is (None if method.bound is None else True)
    assert found["plan"]["means"]["moves_mean"] <= found["homing"]["means"]["moves_mean"]
    assert figures(capsys, *options, "--trials", "8") == found  # the same seed, the same figures
    assert figures(capsys, *options, "--trials", "8", "--seed", "2") != found


def test_localization_without_a_map_takes_longer(capsys):
    options = ("--roi", "eden:30:1", "--localize", "homing", "--trials", "9")
    with_map, without = figures(capsys, *options), figures(capsys, *options, "--no-map")
    assert without["means"]["moves_mean"] > 3 * with_map["means"]["moves_mean"]
    assert without["means"]["right"] == 1.0


def test_localization_with_errors_reports_its_confidence(capsys):
    options = ("--roi", "ragged:60:2", "--localize", "plan", "--noise", "0.056,0.11")
    found = figures(capsys, *options, "--slip", "0.02", "--trials", "60")["rois"][0]
    assert found["right"] >= 0.95
    assert 0.95 <= found["confidence_mean"] < 1.0
    assert found["bound"] is found["bound_held"] is None
    assert found["right"] + found["wrong"] + found["gave_up"] == pytest.approx(1.0)
    low = figures(capsys, *options, "--confidence", "0.6", "--trials", "60")["rois"][0]
    assert low["moves_mean"] < found["moves_mean"]


def test_rois_of_a_file_are_localized(capsys, tmp_path):
    path = tmp_path / "rois.json"
    path.write_text('{"rois": [{"start": [0, 0], "cells": [[0, 0], [1, 0], [2, 0], [3, 0]]}]}')
    found = figures(capsys, "--roi", str(path), "--localize", "plan", "--trials", "5")
    assert found["rois"][0]["cells"] == 4


def test_terminal_gets_a_table(capsys):
    assert main(["simulate", "--roi", "eden:20:1", "--localize", "homing,random"]) == 0
    out = capsys.readouterr().out
    assert "eden:20:1, 100 starts each, with a map" in out
    assert "random" in out
    assert "4 n" in out


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ("--localize plan --robots 3", "--robots 3 with --localize: a robot localizes alone; leave "
         "it out"),
        ("--localize plan --no-map", "--no-map: plan needs a map; leave out one of the two"),
        ("--localize homing --no-map --slip 0.1", "--no-map: a robot with errors needs a "
         "map; leave out --noise and --slip, or --no-map"),
        ("--localize homing --noise 0.6,0", "--noise 0.6,0: false_positive = 0.6: expected 0 to "
         "0.49"),
        ("--localize homing --noise 1", "--noise 1 is not FP,FN, such as 0.05,0.1"),
        ("--localize homing --confidence 0.9", "--confidence is for --noise or --slip: without "
         "errors a robot is certain"),
        ("--localize up", "--localize 'up' is not known; choose one of homing, depth-first, "
         "blum-kozen, random, plan"),
        ("--localize plan --strategy rdfs", "--strategy with --localize: a robot that localizes "
         "explores nothing"),
        ("--localize plan --frame-s 1", "--frame-s with --localize: a robot that localizes moves "
         "from cell to cell"),
        ("--localize plan --index 2", "--index with --localize: there is no picture of a "
         "localization"),
        ("--localize plan --cells 9", "--cells is for --generate"),
        ("--trials 9", "--trials is for --localize METHOD"),
        ("--no-map", "--map is for --localize METHOD"),
    ],
)  # fmt: skip
def test_wrong_combinations_are_refused_in_a_line(options, line, capsys):
    assert main(["simulate", "--roi", "eden:20:1", *options.split()]) == 2
    assert capsys.readouterr().err == f"uavmap: {line}\n"


def test_cells_have_no_length_unless_they_are_drawn(capsys):
    options = ["--generate", "eden", "--localize", "plan", "--cell-m", "3"]
    assert main(["simulate", *options]) == 2
    assert capsys.readouterr().err.startswith("uavmap: --cell-m with --localize is for GeoJSON")
