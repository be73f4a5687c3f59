"""uavmap simulate --localize: figures, the table, and what is refused."""

from __future__ import annotations

import json
from typing import Any

import pytest

from missions.lab.localization.methods import METHODS
from uavmap.ui.cli import main


def figures(capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, Any]:
    assert main(["simulate", *options, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert isinstance(found, dict)
    return found


def test_all_methods_on_grown_rois(capsys, tmp_path):
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


def test_without_a_map_it_takes_longer(capsys):
    options = ("--roi", "eden:30:1", "--localize", "homing", "--trials", "9")
    with_map, without = figures(capsys, *options), figures(capsys, *options, "--no-map")
    assert without["means"]["moves_mean"] > 3 * with_map["means"]["moves_mean"]
    assert without["means"]["right"] == 1.0


def test_with_errors_it_says_how_certain_it_is(capsys):
    options = ("--roi", "ragged:60:2", "--localize", "plan", "--noise", "0.056,0.11")
    found = figures(capsys, *options, "--slip", "0.02", "--trials", "60")["rois"][0]
    assert found["right"] >= 0.95
    assert 0.95 <= found["confidence_mean"] < 1.0
    assert found["bound"] is found["bound_held"] is None
    assert found["right"] + found["wrong"] + found["gave_up"] == pytest.approx(1.0)
    low = figures(capsys, *options, "--confidence", "0.6", "--trials", "60")["rois"][0]
    assert low["moves_mean"] < found["moves_mean"]


def test_rois_of_a_file(capsys, tmp_path):
    path = tmp_path / "rois.json"
    path.write_text('{"rois": [{"start": [0, 0], "cells": [[0, 0], [1, 0], [2, 0], [3, 0]]}]}')
    found = figures(capsys, "--roi", str(path), "--localize", "plan", "--trials", "5")
    assert found["rois"][0]["cells"] == 4


def test_people_get_a_table(capsys):
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
        ("--localize homing --no-map --slip 0.1", "--no-map: who errs compares what it sees with a "
         "map; leave out --noise and --slip, or --no-map"),
        ("--localize homing --noise 0.6,0", "--noise 0.6,0: false_positive = 0.6: expected 0 to "
         "0.49"),
        ("--localize homing --noise 1", "--noise 1 is not FP,FN, such as 0.05,0.1"),
        ("--localize homing --confidence 0.9", "--confidence is for --noise or --slip: who does "
         "not err ends when it is certain"),
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
def test_wrong_combinations_are_refused_in_a_line(options, line, refused):
    assert refused("simulate", "--roi", "eden:20:1", *options.split()) == f"uavmap: {line}"


def test_cells_have_no_length_unless_they_are_drawn(refused):
    options = ["--generate", "eden", "--localize", "plan", "--cell-m", "3"]
    line = refused("simulate", *options)
    assert line.startswith("uavmap: --cell-m with --localize is for GeoJSON")
