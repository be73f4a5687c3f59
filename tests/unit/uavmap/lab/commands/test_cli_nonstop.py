"""`uavmap simulate` with strategies that do not stop over cells, in process."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from uavmap.ui.cli import main

ROW = {
    "makespan_s", "lower_bound_s", "ratio", "cells_missed", "cells_wrong", "plans", "wall_s",
}  # fmt: skip


def printed(capsys: pytest.CaptureFixture[str], *arguments: object) -> Any:
    assert main(["simulate", *(str(a) for a in arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def pair_file(folder: Path) -> Path:
    rois = [
        {"start": [0, 0], "cells": [[0, 0], [1, 0]]},
        {"start": [0, 0], "cells": [[0, 0], [0, 1], [0, 2]]},
    ]
    path = folder / "rois.json"
    path.write_text(json.dumps({"rois": rois}))
    return path


def test_both_strategies_have_their_times_in_seconds(tmp_path, capsys):
    arguments = ("--roi", pair_file(tmp_path), "--strategy", "swath,survey", "--robots", 2)
    once, again = (printed(capsys, *arguments) for _ in range(2))
    assert list(once) == ["swath", "survey"]
    for name in once:
        assert len(once[name]["rois"]) == 2
        for row, same in zip(once[name]["rois"], again[name]["rois"], strict=True):
            assert set(row) == ROW
            assert row.pop("wall_s") > 0.0
            same.pop("wall_s")
            assert row == same
            assert row["cells_missed"] == row["cells_wrong"] == 0
            assert row["makespan_s"] >= row["lower_bound_s"]
        means = once[name]["means"]
        assert set(means) == ROW
        rows = once[name]["rois"]
        assert means["makespan_s"] == pytest.approx(
            sum(r["makespan_s"] for r in rows) / 2, abs=1e-5
        )
    assert once["survey"]["rois"][0]["plans"] == 0


def test_seed_draws_the_errors(capsys):
    def survey(seed: int) -> Any:
        arguments = ("--roi", "eden:60:1", "--strategy", "survey", "--error-rate", 0.3)
        return printed(capsys, *arguments, "--seed", seed)["rois"][0]["cells_wrong"]

    wrong = [survey(seed) for seed in (1, 1, 2, 3)]
    assert wrong[0] == wrong[1]
    assert len(set(wrong)) > 1


def test_survey_is_quicker_with_more_speed_footprint_and_vehicles(capsys):
    def seconds(*more: object) -> float:
        found = printed(capsys, "--roi", "eden:60:1", "--strategy", "survey", *more)
        (row,) = found["rois"]
        assert row["cells_missed"] == 0
        return float(row["makespan_s"])

    base = seconds()
    assert seconds("--speed", 3) > base
    assert seconds("--accel", 5) < base
    assert seconds("--footprint", "23") < seconds("--footprint", "23,15") <= base
    assert seconds("--robots", 2) < base
    assert seconds("--box-factor", 4) > 2 * base
    assert seconds("--cell-m", 2) < base


def test_errors_and_losses_leave_cells_open_or_wrong(capsys):
    arguments = ["--roi", "eden:60:1", "--strategy", "survey"]
    (row,) = printed(capsys, *arguments, "--error-rate", 0.3)["rois"]
    assert row["cells_wrong"] > 0
    (row,) = printed(capsys, *arguments, "--loss-rate", 0.4, "--frame-s", 0.3)["rois"]
    assert row["cells_missed"] > 0


def test_offline_reference_is_within_the_bounds(tmp_path, capsys):
    values = printed(capsys, "--roi", pair_file(tmp_path), "--strategy", "survey", "--offline")
    for row in (*values["rois"], values["means"]):
        assert set(row) == ROW | {"offline_s", "ratio_offline"}
        assert row["lower_bound_s"] <= row["offline_s"] <= row["makespan_s"]
        assert row["ratio_offline"] >= 1.0
    assert main(["simulate", "--roi", "eden:4:1", "--strategy", "survey", "--offline"]) == 0
    assert "offline: the best way found" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--strategy", "swath,rdfs"], "cannot be compared in one table"),
        (["--strategy", "rdfs", "--accel", "2"], "--accel is for --strategy swath or survey"),
        (["--offline"], "--offline is for --strategy swath or survey"),
        (["--strategy", "survey", "--drift", "0.1,90"], "--drift: these strategies"),
        (["--strategy", "survey", "--comms", "shared"], "--comms: these vehicles"),
        (["--strategy", "survey", "--tree", "t.svg"], "--tree: these strategies"),
        (["--strategy", "survey", "--footprint", "4.5"], "too small for cells of 4 m"),
        (["--strategy", "survey", "--footprint", "a,b"], "--footprint a,b is not metres"),
        (["--strategy", "survey", "--footprint", "15,-2"], "not between 0 and 1000"),
        (["--strategy", "survey", "--footprint", "6", "--speed", "50"], "no lanes at this speed"),
        (["--strategy", "swat"], "survey"),
    ],
)
def test_impossible_options_are_refused_in_a_line(arguments, expected, refused):
    assert expected in refused("simulate", "--roi", "eden:9:1", *arguments)


def test_film_of_a_survey_is_a_gif(tmp_path, capsys):
    film = tmp_path / "film.gif"
    arguments = ["simulate", "--roi", "eden:6:1", "--strategy", "survey", "--robots", "2"]
    assert main([*arguments, "--animate", str(film)]) == 0
    assert film.read_bytes().startswith(b"GIF89a")
    capsys.readouterr()
