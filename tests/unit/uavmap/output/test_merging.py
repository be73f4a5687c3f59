"""One map of several journals: any order, any state, and journals that make none together."""

import json
from dataclasses import replace

import pytest

from missions.classes import ClassShare
from missions.errors import JournalError
from missions.events import FrameSeen, LiftedOff, Tracked, Vote
from missions.fleet_events import Fact, FactsShared
from missions.flight.team.members import facts_of
from missions.units import Cell, GridPoint
from tests.support.journals import begun
from tests.support.plans import plan_of
from tests.support.small_missions import mission_text, square
from tests.unit.uavmap.output.flown_folders import CLASSES, EVENTS, PLAN, folder_of
from uavmap.fleet.codec import bytes_to_facts, facts_to_bytes
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL
from uavmap.output.facts.figures import figures
from uavmap.output.merging import merged_results
from uavmap.output.results import flown_of
from uavmap.ui.cli import main

BOX, FENCE = square(-6.0, 12.0, 28.0, 16.0), square(-20.0, -14.0, 56.0, 62.0)
PADS = [(0.0, 0.0), (16.0, 0.0)]
TEXT = mission_text(BOX, FENCE, vehicles=2, homes=PADS, strategy="swath")
ALONE = mission_text(BOX, FENCE, strategy="swath")
CELLS = {1: Cell(0, 4), 2: Cell(2, 4)}


def plan(text=TEXT, member=1, epoch_utc_s=1000.0):
    return plan_of(
        "field.toml", text, None, None, 1, ("udpin://0.0.0.0:14550",), None, epoch_utc_s,
        member=member,
    )  # fmt: skip


def votes(number):
    vote = (Vote(CELLS[number], True, 1.0),)
    frames = [FrameSeen(number, 10.0 * number + k, None, vote) for k in range(3)]
    return [*frames, Tracked(number, 10.0 * number + 9.0, GridPoint(1.0, 2.0), 10.0, 20.0)]


def shared_fact(number):
    facts = [Fact(10.0 * number + 2.0, ((CELLS[number], True),))]
    return FactsShared(number, 40.0, 0, tuple(facts))


def written(folder, by, events):
    return begun(folder, by, sorted(events, key=lambda event: event.t_s))


@pytest.fixture
def pair(tmp_path):
    return [
        written(tmp_path / "one", plan(member=1), [*votes(1), shared_fact(2)]),
        written(tmp_path / "two", plan(member=2, epoch_utc_s=1003.0), [*votes(2)]),
    ]


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != JOURNAL}


def events_in(folder):
    with Journal.open(folder / JOURNAL) as journal:
        return list(journal.events())


def test_order_of_the_folders_changes_nothing(pair, tmp_path):
    lines = []
    summary = merged_results(pair, tmp_path / "a", lines.append)
    merged_results(pair[::-1], tmp_path / "b", lines.append)
    assert summary["cells_roi"] == 2
    assert summary["vehicles"] == 2
    assert [patch["root"]["column"] for patch in summary["patches"]] == [0, 2]
    assert summary["patches_in_all"]["open"] == {"no_frames": 7}  # one lies beside both
    assert summary["patches_in_all"]["took_s"] == 10.0
    assert summary["exploration_s"] is None
    assert files(tmp_path / "a") == files(tmp_path / "b")
    assert events_in(tmp_path / "a") == events_in(tmp_path / "b") == [*votes(1), *votes(2)]


def test_flights_with_look_orders_make_one_map(tmp_path, capsys):
    folders = [
        folder_of(tmp_path / "one"),
        folder_of(tmp_path / "two", EVENTS, replace(PLAN, epoch_utc_s=2e9)),
    ]
    code = main(["merge", *map(str, folders), "--out", str(tmp_path / "both")])
    assert code == 3
    summary = json.loads((tmp_path / "both" / "summary.json").read_text("utf-8"))
    alone = figures(PLAN.known_setting(), EVENTS)[0]
    assert summary["vehicles"] == 2
    assert summary["cells_roi"] >= len(alone.belief.roi) > 0
    assert f"{summary['cells_roi']} cells of the region found" in summary["finding"]
    assert "uavmap resume" not in capsys.readouterr().err


def test_frames_of_a_lost_vehicle_count_as_far_as_others_received_them(pair, tmp_path):
    assert merged_results(pair[:1], tmp_path / "a", print)["cells_roi"] == 2
    assert merged_results(pair[1:], tmp_path / "b", print)["cells_roi"] == 1


def test_map_has_the_classes_in_frames_of_others(tmp_path):
    of_classes = plan(TEXT + CLASSES)
    shared = shared_fact(2)
    (fact,) = shared.frames
    classes = (ClassShare(CELLS[2], 2, 0.3), ClassShare(CELLS[2], 4, 0.6))
    shared = replace(shared, frames=(fact._replace(classes=classes),))
    seen = [
        replace(event, classes=(ClassShare(CELLS[1], 2, 0.9),)) if event.kind == "frame_seen"
        else event
        for event in votes(1)
    ]  # fmt: skip
    folder = written(tmp_path / "one", of_classes, [*seen, shared])
    merged_results([folder], tmp_path / "all", print)
    for flown in (flown_of(folder), flown_of(tmp_path / "all")):
        rest, wet = flown.data.class_areas
        assert (rest.cells, wet.cells) == ((CELLS[1],), (CELLS[2],))
        assert rest.high_m2 == pytest.approx(1.3 * 16.0)
        assert wet.low_m2 == pytest.approx(0.3 * 16.0)  # half of the cells: all rim


def test_unsure_cells_are_those_of_all_vehicles_on_every_map(
    tmp_path,
):
    once, beside = Cell(1, 5), Cell(3, 4)  # shown by one frame of vehicle 2; by both vehicles

    def seen(number):
        cells = {1: (CELLS[1], beside), 2: (CELLS[2], beside, once)}[number]
        doubts = {1: (beside,), 2: (CELLS[2], once)}[number]
        frames = []
        for k in range(3):
            shown = [cell for cell in cells if cell != once or not k]
            said = tuple(Vote(cell, cell not in doubts, 0.5) for cell in shown)
            unsure = tuple(cell for cell in shown if cell in doubts)
            frames.append(FrameSeen(number, 10.0 * number + k, None, said, unsure=unsure))
        return [*frames, *votes(number)[3:]]

    def shared_frames(number):
        own = facts_of(plan().known_setting())
        facts = [fact for event in seen(number) for fact in own.add(event)]
        assert bytes_to_facts(facts_to_bytes(facts)) == tuple(facts)
        return FactsShared(number, 40.0, 0, tuple(facts))

    one = written(tmp_path / "one", plan(member=1), [*seen(1), shared_frames(2)])
    two = written(tmp_path / "two", plan(member=2), [*seen(2), shared_frames(1)])
    station = written(tmp_path / "station", plan(member=0), [shared_frames(2), shared_frames(1)])
    merged_results([one, two], tmp_path / "all", print)
    for folder in (one, two, station, tmp_path / "all"):
        flown = flown_of(folder)
        table = flown.data.cells
        unsure = {Cell(*cell) for cell in table.cells[table.in_state("unsure")].tolist()}
        assert unsure == {beside, CELLS[2], once}  # `beside` was decided first by its doubts
        assert flown.values["cells_unsure"] == 3
        assert not flown.values["completed"]


def test_good_beginning_of_a_damaged_journal_counts(pair, tmp_path):
    journal = pair[1] / JOURNAL
    data = journal.read_bytes()
    third = data.index(b'{"seq":4,')
    data = data[:third] + data[third:].replace(b'"kind"', b'"KIND"', 1)
    journal.write_bytes(data)
    lines = []
    summary = merged_results(pair, tmp_path / "out", lines.append)
    assert summary["cells_roi"] == 2  # the first has received the rest
    assert f"{pair[1]}: its journal is damaged; 2 events are merged, the last of" in lines[0]
    assert journal.read_bytes() == data


def test_flight_under_way_is_read_as_far_as_it_is(pair, tmp_path):
    lines = []
    with Journal.open(pair[1] / JOURNAL) as journal:
        merged_results(pair, tmp_path / "out", lines.append)
        journal.append(LiftedOff(2, 50.0))
    assert any("is still under way; 4 events are merged" in line for line in lines)


def test_flights_over_one_grid_make_one_map(tmp_path):
    early = written(tmp_path / "x" / "out", plan(ALONE, None), [*votes(1)])
    late = written(tmp_path / "y" / "out", plan(ALONE, None, 1600.0), [*votes(1)])
    summary = merged_results([late, early], tmp_path / "all", print)
    assert summary["vehicles"] == 2
    found = events_in(tmp_path / "all")
    frames = [(event.vehicle, event.t_s) for event in found if isinstance(event, FrameSeen)]
    assert frames == [(1, 10.0), (1, 11.0), (1, 12.0), (2, 610.0), (2, 611.0), (2, 612.0)]
    merged_results([early, late], tmp_path / "again", print)
    assert events_in(tmp_path / "again") == found


def test_flights_that_make_no_map_together_are_refused(pair, tmp_path):
    out = tmp_path / "out"
    other = TEXT.replace("layer_m = 6.0", "layer_m = 7.0")
    strangers = {
        "its mission differs from": written(tmp_path / "m", plan(other, 2), []),
        "its grid differs from": written(
            tmp_path / "g", plan(TEXT.replace("cell_m = 4.0", "cell_m = 4.5"), 2), []
        ),
        "is of vehicle 1, like": written(tmp_path / "t", plan(), [LiftedOff(1, 5.0)]),
        "merge the members of a fleet alone": written(tmp_path / "n", plan(ALONE, None), []),
        "there is no journal here": tmp_path / "nothing",
        "is merged already": written(tmp_path / "w", plan(member=0), []),
        "holds the same flight as": pair[0],
    }
    for words, folder in strangers.items():
        for order in ([pair[0], folder], [folder, pair[0]]):
            with pytest.raises(JournalError) as refused:
                merged_results(order, out, print)
            assert words in str(refused.value), words
            assert str(folder.parent) in str(refused.value)
    assert not out.exists()
    with pytest.raises(JournalError, match=f"--out {pair[0]}: holds a journal already"):
        merged_results(pair, pair[0], print)


def test_ground_that_drifts_is_not_the_same_an_hour_later(tmp_path):
    text = ALONE.replace("[drift]\n        speed_m_s = 0.0", "[drift]\n        speed_m_s = 0.2")
    assert text != ALONE
    folders = [
        written(tmp_path / name, plan(text, None, at_s), [*votes(1)])
        for name, at_s in (("one", 0.0), ("two", 3600.0))
    ]
    with pytest.raises(JournalError, match=r"began 3600 s from .*the region drifts"):
        merged_results(folders, tmp_path / "out", print)


def test_many_flights_are_merged_into_a_vehicle_each(tmp_path):
    folders = [
        written(tmp_path / str(k), plan(ALONE, None, 1000.0 * k), [*votes(1)]) for k in range(6)
    ]
    assert merged_results(folders, tmp_path / "out", print)["vehicles"] == 6
    again = merged_results(folders[::-1], tmp_path / "again", print)
    assert again["cells_roi"] == 1
