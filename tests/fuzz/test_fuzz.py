"""Each door of the program accepts hostile inputs, or refuses them with an error of the product."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from missions.errors import AreaError
from tests.fuzz import engine, record
from tests.fuzz.__main__ import NAMES
from tests.fuzz.engine import Target
from tests.fuzz.targets import TARGETS

EXECUTIONS = 40


def test_command_names_every_target():
    assert tuple(TARGETS) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_target_examples_kept_and_changed_inputs_do_not_fail(name, tmp_path):
    target = TARGETS[name]
    known = [(path.name, path.read_bytes()) for path in engine.kept(name)]
    examples = target.examples(tmp_path)
    known += [(f"example {k}", data) for k, data in enumerate(examples)]
    found = {title: engine.fault(target, data, tmp_path) for title, data in known}
    assert {title: fault for title, fault in found.items() if fault} == {}
    assert engine.plain(target, examples, tmp_path, 1, EXECUTIONS, 60.0).found == {}


@pytest.mark.parametrize(
    ("act", "fault"),
    [
        (lambda: None, None),
        (lambda: AreaError("refused"), None),
        (lambda: KeyError("a"), "KeyError at tests/fuzz/test_fuzz.py:check"),
        (lambda: AssertionError("wrong"), "AssertionError at tests/fuzz/test_fuzz.py:check"),
    ],
)
def test_fault_names_error_and_place_of_an_input_that_is_not_refused(act, fault, tmp_path):
    def check(data: bytes, folder: Path) -> None:
        if (error := act()) is not None:
            raise error

    assert engine.fault(Target("a", lambda _: [b""], check), b"", tmp_path) == fault


def test_fault_ends_an_input_that_hangs_in_a_reader_of_damaged_files(tmp_path):
    def check(data: bytes, folder: Path) -> None:
        try:
            while True:
                pass
        except Exception as error:
            raise AreaError("damaged") from error

    found = engine.fault(Target("a", lambda _: [b""], check), b"", tmp_path, most_s=0.05)
    assert found == "TooLongError at tests/fuzz/test_fuzz.py:check"


def test_plain_run_changes_inputs_that_get_new_answers_further(tmp_path):
    def check(data: bytes, folder: Path) -> None:
        if data.count(b"-1") > 2:
            raise RuntimeError
        raise AreaError(f"{'x' * data.count(b'-1')} of them")

    target, examples = Target("a", lambda _: [b""], check), [b"1 2 3 4 5"]
    found = engine.plain(target, examples, tmp_path, 2, 1500, 60.0)
    assert list(found.found) == ["RuntimeError at tests/fuzz/test_fuzz.py:check"]
    again = engine.plain(target, examples, tmp_path, 2, 1500, 60.0)
    assert (again.executions, again.found) == (found.executions, found.found)


def test_record_keeps_a_row_for_each_run(tmp_path):
    path = tmp_path / "runs.json"
    for seed in (1, 2):
        record.keep(record.row("areas", seed, 2.0, engine.Result(7, 30, {"a": b""})), path)
    rows = record.kept(path)
    assert [(r["seed"], r["executions"], r["failures"]) for r in rows] == [
        (1, 7, ["a"]),
        (2, 7, ["a"]),
    ]
    assert json.loads(path.read_text("utf-8")) == rows
