"""The fit of a detector by the frames of a flight, and flights without a verdict."""

import io
from dataclasses import replace

import pytest

from missions.events import FrameSeen, Vote, from_json
from missions.flight.setting_of import setting_of
from missions.flight.step import step
from missions.mapping.persistent import PersistentSet
from missions.mission.sections import DetectorSection
from missions.units import Cell
from tests.golden.recording import STOPS
from tests.support.small_missions import mission, square
from uavmap.base.terminal import Terminal
from uavmap.load.mission_source import load
from uavmap.output.facts.detector_fit import (
    FIRST_FRAMES,
    MIN_FRAMES,
    DetectorFit,
    is_untouched,
    no_verdict,
    with_unsure,
)
from uavmap.output.facts.map_model import CellRow, CellTable
from uavmap.runner.operator.progress import ProgressTable
from uavmap.ui.cli import AIRCRAFT_DOWN, INCOMPLETE, NO_VERDICT
from uavmap.ui.cli.common import report, rows
from uavmap.ui.page.watching import Watcher


def frame(number, positive, in_all=10):
    """Return a frame of its own ground; some of its cells look like region."""
    votes = (Vote(Cell(number, k), k < positive, float(k < positive)) for k in range(in_all))
    return FrameSeen(1, float(number), None, tuple(votes))


def fit_of(positive, frames=MIN_FRAMES):
    fit = DetectorFit()
    for number in range(frames):
        fit.note(frame(number, positive))
    return fit


@pytest.mark.parametrize(
    ("positive", "expected", "warns"),
    [
        (0, "marks no region in the first 100 pictures; the search", False),
        (9, "marks 90 % of the ground in the first 100 pictures as region: check whether", True),
        (10, "marks 100 % of the ground in the first 100 pictures as region: check", True),
        (1, None, False),
        (8, None, False),
    ],
)
def test_detector_fit_after_the_first_frames_reports_once(positive, expected, warns):
    fit = DetectorFit()
    news = [fit.note(frame(number, positive)) for number in range(3 * FIRST_FRAMES)]
    lines = [(number, one) for number, one in enumerate(news, 1) if one is not None]
    if expected is None:
        assert not lines
        return
    ((number, one),) = lines
    assert number == FIRST_FRAMES
    assert expected.replace("0 %", "0%") in one.text
    assert one.warns == warns


def test_detector_fit_counts_ground_once_however_often_seen():
    fit = DetectorFit()
    fit.note(frame(0, 0, 80))
    for _ in range(200):
        fit.note(frame(1, 20, 20))
    assert fit.share == pytest.approx(20 / 100)
    assert not fit.marks_nearly_all


def flight():
    setting = STOPS.setting()
    state = setting.initial_state()
    for line in STOPS.lines():
        state, _ = step(state, from_json(line))
    assert state.completed
    return setting, state


def with_detector(state, **section):
    mission = state.setting.mission.model_copy(update={"detector": DetectorSection(**section)})
    return replace(state, setting=replace(state.setting, mission=mission))


def test_no_verdict_nearly_all_is_region_on_any_ground():
    setting, state = flight()
    for real in (False, True):
        assert "90% of the 200 observed cells" in no_verdict(state, fit_of(9), real=real)
    assert no_verdict(state, fit_of(8), real=True) == ""
    assert no_verdict(state, fit_of(9, MIN_FRAMES - 1), real=True) == ""
    assert no_verdict(setting.initial_state(), fit_of(9), real=True) == ""  # not over


def test_no_verdict_without_region_depends_on_ground_and_detector():
    _, state = flight()
    state = with_detector(state)
    nothing = replace(state, belief=replace(state.belief, roi=PersistentSet()))
    assert "no region in the whole box" in no_verdict(nothing, fit_of(0), real=True)
    assert no_verdict(nothing, fit_of(0), real=False) == ""
    assert no_verdict(state, fit_of(0), real=True) == ""  # it has found one
    chosen = with_detector(nothing, intensity=100)
    assert no_verdict(chosen, fit_of(0), real=True) == ""


@pytest.mark.parametrize(
    ("section", "untouched"),
    [
        ({}, True),
        ({"threshold": {}}, True),
        ({"threshold": {"intensity": 150}}, True),
        ({"threshold": {"intensity": 140}}, False),
        ({"polarity": "bright"}, False),
        ({"name": "paved"}, False),
    ],
)
def test_detector_is_untouched_only_with_all_default_values(section, untouched):
    assert is_untouched(DetectorSection(**section)) == untouched


def test_terminal_and_page_report_a_detector_that_finds_region_everywhere():
    setting = setting_of(mission(square(-10, 16, 40, 30), square(-60, -60, 160, 160)))
    state, out = setting.initial_state(), io.StringIO()
    table, watcher = ProgressTable(Terminal(out)), Watcher(state, real=True)
    for number in range(FIRST_FRAMES):
        table.notice(frame(number, 10))
        table.update(frame(number, 10), state, 0)
        watcher.apply(frame(number, 10), state)
    assert "marks 100% of the ground in the first 100 pictures as region" in out.getvalue()
    watcher.refresh(whole=True)
    ((_, level, text),) = [line[-3:] for line in watcher.board.since(0)["log"]]
    assert level == "warning"
    assert "as region" in text


@pytest.mark.parametrize(
    ("down", "verdict", "code"),
    [([], "x", NO_VERDICT), (["1 is down"], "x", AIRCRAFT_DOWN), ([], None, INCOMPLETE)],
)
def test_report_no_verdict_has_an_exit_code_of_its_own(down, verdict, code, tmp_path, capsys):
    summary = {
        "mission": "m", "strategy": "s", "completed": False, "no_verdict": verdict,
        "finding": "f", "aircraft_down": down, "seed": None,
    }  # fmt: skip
    assert report(summary, tmp_path, as_json=False) == code
    assert ("to continue: uavmap resume" in capsys.readouterr().err) == (verdict is None)
    ended = "no" if verdict is None else "no verdict"
    assert dict(rows(summary, tmp_path))["mission completed"] == ended


def test_flight_with_unsure_cells_is_not_complete_and_asks_for_pictures(tmp_path, capsys):
    setting = setting_of(load("runway"))
    cells = [CellRow(Cell(0, 0), "unsure", 0, 3), CellRow(Cell(1, 0), "explored", 3, 3)]
    flown = {
        "mission": "runway", "strategy": "swath", "completed": True, "finding": "a patch",
        "aircraft_down": [], "seed": None,
    }  # fmt: skip
    summary = with_unsure(flown, CellTable.from_rows(cells), setting)
    assert (summary["completed"], summary["flown_to_the_end"]) == (False, True)
    assert (summary["cells_unsure"], summary["cells_unsure_m2"]) == (1, 16.0)
    assert summary["finding"].startswith("a patch; 1 cells (16 sq m) are unsure")
    (tmp_path / "next.txt").write_text("1.jpg\t16\n")
    assert report(summary, tmp_path, as_json=False) == 3
    shown = capsys.readouterr()
    assert dict(rows(summary, tmp_path))["paint next"].endswith("next.txt")
    assert "paint pictures of them" in shown.err
    assert "uavmap resume" not in shown.err
    assert with_unsure(flown, CellTable.from_rows(cells[1:]), setting)["completed"] is True
