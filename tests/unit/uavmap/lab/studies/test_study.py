"""uavmap study: its files, its results, and its messages if it cannot run."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import distributed
import pytest

from missions.planning.stepwise.interface import Metric
from missions.units import Cell
from uavmap.lab.commands import study as command
from uavmap.lab.commands.study import Progress
from uavmap.lab.studies import (
    STUDIES,
    greedy_table_1,
    lrv_figure_3,
    roi_bounds,
    roi_figure_7,
    strategy_comparison,
    two_robots,
)
from uavmap.lab.studies.outcomes import PLAIN
from uavmap.lab.studies.roi_figure_7 import lawn_mower
from uavmap.lab.studies.strategy_comparison import reference
from uavmap.ui.cli import main


def study(name: str, folder: Path, *options: str) -> list[dict[str, str]]:
    """Return the rows of a quick study's CSV."""
    assert main(["study", name, "--quick", "--out", str(folder), *options]) == 0
    assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    page = (folder / f"{name}.md").read_text()
    assert page.startswith("# ")
    assert f"{name}.png" in page
    with (folder / f"{name}.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows
    assert page.count("\n|") > len(rows)
    return rows


# --- what is found ---------------------------------------------------------------------------
def test_greedy_table_1_is_the_papers_to_the_digit_also_as_json(tmp_path, capsys):
    (tmp_path / "roi-bounds.md").write_text("another study")
    rows = study("greedy-table-1", tmp_path, "--json")
    assert [int(row["n"]) for row in rows] == [3, 4, 5]
    assert all(row["equal"] == "yes" and row["by"] == "simulation" for row in rows)
    found = json.loads(capsys.readouterr().out)
    assert found["study"] == "greedy-table-1"
    assert [row["travel"] for row in found["rows"]] == [int(row["travel"]) for row in rows]


@pytest.mark.parametrize("n", sorted(greedy_table_1.PAPER))
def test_formulas_give_the_papers_rows(n):
    assert (greedy_table_1.travel(n), greedy_table_1.vertices(n)) == greedy_table_1.PAPER[n]


@pytest.mark.parametrize("n", [6, 7])
def test_larger_rows_come_out_of_the_simulation(n):
    assert greedy_table_1.simulate(n) == greedy_table_1.PAPER[n]


def test_lrv_figure_3_is_within_two_thousandths_of_the_paper(tmp_path):
    rows = {int(row["m"]): row for row in study("lrv-figure-3", tmp_path)}
    assert abs(float(rows[100]["off by, %"])) < 0.2
    assert all(float(row["ln V"]) < float(row["random walk / V"]) for row in rows.values())


@pytest.mark.parametrize(
    ("m", "tolerance"), [(m, 0.0001) for m in lrv_figure_3.PAPER if m >= 300] + [(100, 0.0005)]
)
def test_formula_gives_the_papers_sequence(m, tolerance):
    assert lrv_figure_3.formula(m) == pytest.approx(lrv_figure_3.PAPER[m], rel=tolerance)


def test_roi_figure_7_breaks_no_bound_and_shows_the_papers_trends(tmp_path, monkeypatch):
    monkeypatch.setattr(roi_figure_7, "QUICK_TRIALS", 2)
    rows = study("roi-figure-7", tmp_path)
    assert {row["violations"] for row in rows} == {"0"}
    for row in rows:
        assert float(row["lower bound"]) <= float(row["mean"]) <= float(row["upper bound"])
        assert float(row["upper bound"]) < float(row["paper's upper"])
    page = (tmp_path / "roi-figure-7.md").read_text()
    assert "**0 violations" in page
    assert "| time falls with the speed ratio | yes | yes | yes |" in page


def test_broken_bound_is_counted():
    assert len(roi_figure_7.jobs(False, 1)) >= 10_000  # the full study
    done = roi_figure_7.trial(roi_figure_7.jobs(True, 1)[0])
    assert not done.violated
    assert replace(done, makespan=done.upper * 1.01).violated
    assert replace(done, makespan=done.lower * 0.99).violated


def test_roi_bounds_distinguishes_the_readings_of_algorithm_1(tmp_path):
    rows = study("roi-bounds", tmp_path)
    above = dict.fromkeys(roi_bounds.SIZES, 0)
    for row in rows:
        above[row["strategy"]] += int(row["above Lemma 1"])
        assert row["below lower bound"] == "0"
    assert above["rdfs"] == above[PLAIN] == 0 < above["rdfs-paper"]
    large = [row for row in rows if int(row["cells"]) == roi_bounds.QUICK_LARGE]
    deep = [row for row in large if row["strategy"] == PLAIN]
    assert all(float(row["mean depth_T"]) > float(row["mean ecc"]) for row in deep)
    assert sum(int(row["above Lemma 1 with ecc"]) for row in deep) > 0


def test_strategies_compares_with_the_prototypes(tmp_path, monkeypatch):
    monkeypatch.setattr(strategy_comparison, "QUICK_CELLS", 12)
    monkeypatch.setattr(strategy_comparison, "QUICK_TRIALS", 1)
    rows = study("strategies", tmp_path)
    assert {"rdfs", "rdfs-paper"} <= {row["strategy"] for row in rows}
    assert {row["bound broken"] for row in rows} == {"0"}
    assert all(float(row["T / LB"]) >= 1 for row in rows)
    assert reference("eden", 120, 20, "horizon") == 1.06
    assert reference("thin", 120, 20, "horizon") is None


def test_homing_robot_keeps_its_bounds_and_meets_the_papers_grids(tmp_path):
    rows = study("homing-robot", tmp_path)
    assert {row["bound broken"] for row in rows if row["part"] != "errors"} == {"0"}
    assert {row["right"] for row in rows if row["part"] != "errors"} == {"1"}
    ratio = {row["grid"]: float(row["most moves / n"]) for row in rows if row["part"] == "worst"}
    assert round(ratio["studded 50"], 3) == 2.649
    assert ratio["chevrons 4, 5"] == pytest.approx(303 / 140)
    page = (tmp_path / "homing-robot.md").read_text()
    assert "**0 violations** in 100 runs" in page
    assert "0 of\n28 needed fewer" in page


def test_two_robots_agrees_with_the_paper(tmp_path):
    rows = study("two-robots", tmp_path)
    assert {row["covering"] for row in rows} == {"triangles", "diamonds"}
    for row in rows:
        stripes = two_robots.QUICK_STRIPES
        assert abs(float(row["steps"]) - float(row["paper: steps"])) <= 3 * stripes
        assert abs(float(row["off, %"])) < 4.0
    assert "as printed" in (tmp_path / "two-robots.md").read_text()


def test_leapfrog_reports_the_gain_of_tracked_errors(tmp_path):
    rows = study("leapfrog", tmp_path)
    assert {(row["m"], row["hops"]) for row in rows} == {
        ("50", "6"), ("100", "12"), ("50", "5"), ("100", "9")
    }  # fmt: skip
    assert all(float(row["times better"]) > 1.5 for row in rows)
    assert "tracked errors are" in (tmp_path / "leapfrog.md").read_text().lower()


# --- the lawn mower --------------------------------------------------------------------------
def test_lawn_mower_splits_its_rectangle_in_the_better_direction():
    corners = [Cell(0, 0), Cell(9, 3)]
    assert lawn_mower(corners, 1, Metric()) == 39
    assert lawn_mower(corners, 2, Metric()) == 19
    assert lawn_mower(corners, 5, Metric()) == 7
    assert lawn_mower(corners, 100, Metric()) == 3


def test_lawn_mower_in_a_drift_takes_the_cheaper_lanes():
    """Short lanes across the drift, and onward against it."""
    metric = Metric(speed=2.0, drift_east=1.0)
    along, against, aside = 1 / (2 - 1), 1 / (2 + 1), 1 / 3**0.5
    one, other = 9 * (along + against) + aside, 10 * aside + 9 * against
    assert lawn_mower([Cell(0, 0), Cell(9, 1)], 1, metric) == pytest.approx(min(one, other))
    assert lawn_mower([Cell(0, 0), Cell(9, 0)], 1, metric) == pytest.approx(9 * against)


# --- where it is computed --------------------------------------------------------------------
def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_trials_on_any_workers_give_the_same_files(tmp_path, capsys):
    study("roi-bounds", tmp_path / "here")
    study("roi-bounds", tmp_path / "processes", "--workers", "2")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp://", host="127.0.0.1",
        dashboard_address=None,
    ) as cluster:  # fmt: skip
        study("roi-bounds", tmp_path / "cluster", "--scheduler", cluster.scheduler_address)
    assert files(tmp_path / "here") == files(tmp_path / "processes") == files(tmp_path / "cluster")


def test_another_seed_gives_other_trials():
    for name in ("roi-figure-7", "roi-bounds", "strategies", "lrv-figure-3"):
        assert STUDIES[name].jobs(True, 1) == STUDIES[name].jobs(True, 1)
        assert STUDIES[name].jobs(True, 1) != STUDIES[name].jobs(True, 2)


def test_results_keep_the_order_of_the_jobs():
    assert command.spread(abs, [-3, 2, -1]) == [3, 2, 1]
    assert command.spread(abs, range(-40, 0), workers=2) == list(range(40, 0, -1))
    assert command.spread(abs, []) == []


# --- what is said ----------------------------------------------------------------------------
def test_missing_extra_is_named_with_the_remedy(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(command, "find_spec", lambda name: None)
    assert main(["study", "strategies", "--out", str(tmp_path / "new")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("uavmap: studies need matplotlib and numba: ")
    assert error.endswith(" -m pip install 'matplotlib>=3.9' 'numba>=0.61'\n")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("tcp://127.0.0.1:1", "uavmap: --scheduler tcp://127.0.0.1:1: no Dask scheduler"),
        *((a, "expected tcp://HOST:PORT") for a in ("", "here", "tcp://h", ":8786")),
        *((a, "expected tcp://HOST:PORT") for a in ("http://h:1", "tcp://h:70000")),
    ],
)
def test_invalid_scheduler_is_named(address, expected, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(command, "ANSWER_S", 0.3)
    assert main(["study", "strategies", "--out", str(tmp_path), "--scheduler", address]) == 2
    assert expected in capsys.readouterr().err


def test_cluster_without_dask_is_named(tmp_path, capsys, monkeypatch):
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(command, "import_module", missing)
    assert main(["study", "strategies", "--out", str(tmp_path), "--scheduler", "x:1"]) == 2
    assert "pip install 'distributed>=" in capsys.readouterr().err


def test_output_folder_that_cannot_be_made_is_named(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["study", "strategies", "--out", str(tmp_path / "file" / "x")]) == 2
    assert "cannot be made: Not a directory" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["csv", "png", "md"])
def test_existing_results_are_not_overwritten(kind, tmp_path, capsys):
    kept = tmp_path / f"strategies.{kind}"
    kept.write_text("ours")
    assert main(["study", "strategies", "--quick", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == (
        f"uavmap: --out {tmp_path}: already has a {kept.name}; choose another folder\n"
    )
    assert [path.read_text() for path in tmp_path.iterdir()] == ["ours"]


def test_ctrl_c_ends_a_study_in_a_line(tmp_path, capsys, monkeypatch):
    def interrupted(job: object) -> None:
        raise KeyboardInterrupt

    broken = replace(STUDIES["strategies"], trial=interrupted)
    monkeypatch.setattr(command, "STUDIES", {"strategies": broken})
    assert main(["study", "strategies", "--quick", "--out", str(tmp_path)]) == 130
    assert capsys.readouterr().err == "uavmap: interrupted\n"
    assert not list(tmp_path.iterdir())


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("stream", [io.StringIO(), Terminal()])
def test_progress_is_shown_after_two_seconds(stream, monkeypatch):
    now_s = 100.0
    monkeypatch.setattr(command.time, "monotonic", lambda: now_s)
    progress = Progress("name", 8, stream)
    now_s = 101.9
    progress.update(1)
    assert stream.getvalue() == ""
    now_s = 103.0
    progress.update(3)
    assert "name: 3 of 8 trials" in stream.getvalue()
    once = stream.getvalue()
    now_s = 103.1
    progress.update(4)
    assert stream.getvalue() == once
    progress.end()
    assert stream.getvalue().endswith("\033[K" if stream.isatty() else "\n")
