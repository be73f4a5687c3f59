"""`uavmap simulate` as a process."""

import json

import pytest

from tests.e2e.rig import python, uavmap


def test_simulation_repeats_itself(tmp_path):
    arguments = ["simulate", "--generate", "eden", "--cells", 40, "--count", 4, "--robots", 3]
    arguments += ["--drift", "0.3,45", "--json"]
    once = uavmap(*arguments, "--out", tmp_path / "out", hash_seed="1")
    again = uavmap(*arguments, hash_seed="2")
    assert once.code == again.code == 0
    assert json.loads((tmp_path / "out" / "summary.json").read_text("utf-8")) == once.summary
    rows, rows_again = once.summary["rois"], again.summary["rois"]
    assert len(rows) == 4
    for row in (*rows, *rows_again):
        assert row.pop("wall_s") > 0.0
        assert row.pop("lower_bound_wall_s") > 0.0
        assert row["lower_bound"] <= row["makespan"] <= row["bound"]
    assert rows == rows_again


def test_slow_imports_are_loaded_when_needed():
    code = "import sys, uavmap.ui.cli; print(sorted({'numba', 'matplotlib'} & set(sys.modules)))"
    assert python("-c", code).out == "[]\n"


@pytest.mark.parametrize(
    ("roi", "strategy", "robots"), [("eden:30:1", "horizon", 3), ("eden:3:1", "swath", 2)]
)
def test_strategy_plans_the_same_compiled_or_not(roi, strategy, robots, monkeypatch):
    found = []
    for plain in "01":
        monkeypatch.setenv("NUMBA_DISABLE_JIT", plain)
        words = ["simulate", "--roi", roi, "--strategy", strategy, "--robots", robots, "--json"]
        (row,) = uavmap(*words).summary["rois"]
        found.append({key: value for key, value in row.items() if not key.endswith("wall_s")})
    assert found[0] == found[1]
