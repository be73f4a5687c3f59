"""The beginning of a report: one or two sentences that are true of each kind of ending."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from missions.events import Event, FrameSeen, Tracked, Vote
from missions.units import Cell, GridPoint
from tests.support.page.html_page import Page
from tests.unit.uavmap.output.flown_folders import CLASS_EVENTS, CLASS_PLAN, EVENTS, PLAN, folder_of
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.report import words
from uavmap.output.report.page import encode
from uavmap.output.results import flown_of

UNSEEN = (
    "Unseen ground: 16 m² (0.002 ha) of the search area (8 %) have no verdict: 1 cell in too few "
    "pictures. A piece of the region may be missing there."
)


def flown(tmp: Path, events: Sequence[Event] = EVENTS, **meta: Any) -> FlownMission:
    plan = meta.pop("plan", PLAN)
    return flown_of(folder_of(tmp, events, plan, **meta))


def seen(event: Event, **changes: Any) -> Event:
    """Return a frame with other facts; any other event unchanged."""
    if not isinstance(event, FrameSeen):
        return event
    return replace(event, **{name: change(event) for name, change in changes.items()})


def no_region(event: FrameSeen) -> tuple[Vote, ...]:
    return tuple(vote._replace(positive=False) for vote in event.votes)


def photographed(
    taken: int, *, region: bool = True, refused: int = 0
) -> tuple[list[Event], dict[str, Any]]:
    """Return the journal of a replay: pictures of the same four cells."""
    from missions.events import FrameLost  # noqa: PLC0415

    events: list[Event] = []
    cells = [Cell(0, 0), Cell(1, 0), Cell(0, 1), Cell(5, 5)]
    for n in range(taken):
        events.append(Tracked(1, float(n), GridPoint(0.0, 0.0), 40.0, 60.0))
        votes = tuple(Vote(cell, region and cell.east < 2, 0.5) for cell in cells)
        events.append(FrameSeen(1, float(n), Cell(0, 0), votes))
    events += [FrameLost(1, float(taken + n), "blurred") for n in range(refused)]
    return events, {"replay": {}}


def test_words_of_a_complete_flight(tmp_path: Path) -> None:
    found = flown(tmp_path)
    assert words.outcome(found) == "The region is mapped to its edge all around."
    assert words.unknowns(found) == [UNSEEN]
    assert words.left_undone(found, 9)[0] == (
        "Search area: 11 of 12 cells decided, 1 in too few frames."
    )


def test_words_of_a_flight_that_saw_the_whole_box(tmp_path: Path) -> None:
    found = flown(tmp_path)
    box = {"cells": 12, "decided": 12, "few_frames": 0, "no_frames": 0, "beyond_fence": 0}
    in_all = {**found.values["patches_in_all"], "box": {**box, "whole": True}}
    found = replace(found, values={**found.values, "patches_in_all": in_all})
    assert words.outcome(found).endswith("around. The whole search area was seen.")
    assert words.unknowns(found) == []
    assert words.left_undone(found, 9) == ["Nothing is known to be missing, and no fault is known."]


def test_words_of_an_unfinished_flight(tmp_path: Path) -> None:
    middle = next(i for i, event in enumerate(EVENTS) if event.t_s > 50.0)
    found = flown(tmp_path, EVENTS[:middle])
    assert words.outcome(found) == (
        "The flight is not complete: this is the map at mission time 0:49 min. The region may be "
        "larger, and there may be more of it elsewhere."
    )
    unseen, goes_on, *_ = words.unknowns(found)
    assert unseen.startswith("Unseen ground: ")
    assert goes_on.startswith("The region may go on")


def test_words_of_a_flight_that_has_not_begun(tmp_path: Path) -> None:
    found = flown(tmp_path, [])
    assert words.outcome(found).endswith("No region is found so far.")
    assert "(100 %) have no verdict: 12 cells in no picture" in words.unknowns(found)[0]
    assert words.size(found) is None
    assert words.middle_place(found).name == "Home"


def test_words_of_a_flight_without_a_region(tmp_path: Path) -> None:
    found = flown(tmp_path, [seen(event, votes=no_region) for event in EVENTS])
    assert words.outcome(found) == "No region was found."
    assert words.unknowns(found)[0] == UNSEEN
    assert "none found" in Page(encode(found).decode()).text


def test_words_of_a_flight_without_a_verdict(tmp_path: Path) -> None:
    found = flown(tmp_path)
    why = "the detector marked 97% of the 1,204 observed cells as region"
    found = replace(found, values={**found.values, "completed": False, "no_verdict": why})
    assert words.outcome(found) == f"No verdict: {why}. The map does not show the region."


def test_words_of_several_pieces(tmp_path: Path) -> None:
    found = flown(tmp_path)
    several = [*found.values["patches"]] * 3
    found = replace(found, values={**found.values, "patches": several})
    assert words.outcome(found) == (
        "The region has 3 pieces; each is mapped to its edge all around."
    )


def test_words_of_a_region_that_is_open(tmp_path: Path) -> None:
    found = flown(tmp_path)
    open_cells = {"complete": False, "open": {"no_frames": 2, "skipped": 1}}
    in_all = {**found.values["patches_in_all"], **open_cells}
    found = replace(found, values={**found.values, "patches_in_all": in_all})
    assert words.outcome(found) == (
        "The flight is over, and the edge of the region is open in places."
    )
    assert words.unknowns(found)[1] == (
        "The region may go on: its edge is open at 3 cells: 2 in no frame, 1 skipped by the "
        "operator."
    )


def test_unsure_ground_comes_first(tmp_path: Path) -> None:
    def unsure(event: FrameSeen) -> tuple[Cell, ...]:
        return tuple(vote.cell for vote in event.votes if not vote.positive)

    found = flown(tmp_path, [seen(event, unsure=unsure) for event in EVENTS])
    cells = found.values["cells_unsure"]
    assert cells > 0
    first, second = words.unknowns(found)[:2]
    assert first == (
        f"Unsure ground: {words.area(16.0 * cells)} are unlike what the detector knows. They may "
        "belong to the region; its area does not contain them."
    )
    assert second == UNSEEN
    assert words.outcome(found) == "The region is mapped, except where ground is unsure."
    text = Page(encode(found).decode()).text
    assert text.index("Unsure ground") < text.index("Unseen ground") < text.index("Area of the")


def test_words_of_classes(tmp_path: Path) -> None:
    found = flown(tmp_path, CLASS_EVENTS, plan=CLASS_PLAN)
    assert list(words.class_lines(found)) == [
        "rest: 32 m² (8 to 34)",
        "wet & <dry>: 64 m² (21 to 74), 0.0213 to 0.148 litres",
    ]


@pytest.mark.parametrize(
    ("taken", "region", "refused", "outcome"),
    [
        (5, True, 0, "The region is mapped from 5 pictures. Ground that no picture shows is not "),
        (5, False, 0, "No region is in 5 pictures. Ground that no picture shows is not judged."),
        (5, True, 6, "Only 5 of 11 pictures can be used. The map is not reliable."),
        (0, True, 3, "None of 3 pictures can be used. There is no map."),
    ],
)
def test_words_of_a_replay(
    taken: int, region: bool, refused: int, outcome: str, tmp_path: Path
) -> None:
    events, meta = photographed(taken, region=region, refused=refused)
    found = flown(tmp_path, events, **meta)
    assert found.recorded
    assert words.outcome(found).startswith(outcome)
    assert ("Pictures in the map", f"{taken} of {taken + refused}") == (
        words.pictures(found)[0][0],
        words.pictures(found)[0][1].partition(";")[0],
    )


def test_words_of_a_replay_with_too_few_pictures_of_some_ground(tmp_path: Path) -> None:
    events, meta = photographed(2)
    assert words.unknowns(flown(tmp_path, events, **meta))[0].startswith(
        "Unseen ground: 64 m² (0.006 ha) are in too few pictures to be judged."
    )
