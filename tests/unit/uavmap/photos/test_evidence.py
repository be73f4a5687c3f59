"""Maps by evidence: weights, each picture once, and the memory that it takes."""

from __future__ import annotations

import json
import random
import shutil
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from missions.events import FrameSeen, FrameWeighed, Vote, from_json, to_json
from missions.flight.setting_of import setting_of
from missions.mapping.belief import Belief, FrameId
from missions.mapping.evidence import Evidence, evidence_of
from missions.units import Cell
from tests.benchmarks.photos.replay import write_survey
from tests.unit.uavmap.output.maps import make_map
from tests.unit.uavmap.photos.sources.test_replay_robust import PLACES, good, mapped, shot
from tests.unit.uavmap.photos.test_replay import paint
from uavmap.journal.event_log import Journal
from uavmap.load.mission_source import mission_of_text
from uavmap.output.facts.flown_mission import extent
from uavmap.output.facts.map_model import CellTable
from uavmap.output.formats import geojson_encoder as geojson
from uavmap.output.formats import kml_encoder as kml
from uavmap.output.results import Votes, weighed
from uavmap.photos.mission_from_photos import derived
from uavmap.photos.picture_replay import JudgedPictures, judge_pictures
from uavmap.photos.scratch_file import Spool
from uavmap.photos.sources.inventory import gather, open_source
from uavmap.photos.workers import Threads
from uavmap.ui.cli import main
from vision.projection import weights

__all__ = ["good"]  # a fixture

HERE, THERE = Cell(0, 0), Cell(1, 0)
SQUARE = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 20.0], [0.0, 20.0]])


def weight(seen: float = 1.0, scale: float = 1.0, slant: float = 0.0) -> float:
    (found,) = weights(np.array([seen]), SQUARE[None] * scale, np.array([slant]))
    return float(found)


def test_coverage_resolution_and_obliqueness_weigh() -> None:
    assert weight(seen=0.5) == pytest.approx(0.5 * weight())
    assert weight(scale=0.4) == pytest.approx(0.5)  # 8 px along the edge
    assert weight(slant=1.0) == pytest.approx(weight() / 4.0)  # at 45 degrees
    assert weight(scale=10.0) < 1.0 < 1.2 * weight(scale=10.0)
    behind = weights(np.ones(1), np.full((1, 4, 2), np.nan), np.zeros(1))
    assert behind.tolist() == [0.0]


def test_view_from_above_outweighs_two_oblique_ones() -> None:
    evidence = Evidence()
    evidence.add([Vote(HERE, True, 0.9)], [0.9])
    for _ in range(2):
        evidence.add([Vote(HERE, False, 0.1)], [0.2])
    assert evidence.is_roi(HERE, 0.5)
    assert evidence.cells() == {HERE: (1, 3)}


def test_share_is_a_mean_and_many_pictures_do_not_make_it_more() -> None:
    evidence = Evidence()
    for _ in range(50):
        evidence.add([Vote(HERE, False, 0.3)], [0.9])
    assert evidence.belief(HERE) == pytest.approx(0.3)


def test_too_little_weight_decides_nothing() -> None:
    evidence = Evidence()
    evidence.add([Vote(HERE, True, 1.0), Vote(THERE, True, 1.0)], [0.04, 0.9])
    found = evidence.weighings()
    assert [Cell(*cell) for cell in found.cells[found.roi(0.5)].tolist()] == [THERE]
    assert found.decided.sum() == 1


def test_order_of_pictures_does_not_change_a_belief() -> None:
    rng = random.Random(3)
    pictures = [
        ([Vote(HERE, True, round(rng.random(), 3))], [round(rng.random(), 3)]) for _ in range(30)
    ]
    beliefs = set()
    for _ in range(5):
        evidence = Evidence()
        for votes, weighs in pictures:
            evidence.add(votes, weighs)
        beliefs.add(evidence.belief(HERE))
        rng.shuffle(pictures)
    assert len(beliefs) == 1


@pytest.mark.parametrize("seed", range(4))
def test_votes_are_those_of_a_belief(seed: int) -> None:
    """Sums are enough if pictures come in the order of their exposure."""
    rng = np.random.default_rng(seed)
    votes, belief = Votes(3, 2), Belief(3, 2)
    for number in range(60):
        vantage = Cell(int(rng.integers(0, 2)), 0)
        votes_of_one = [
            Vote(Cell(int(east), int(north)), bool(rng.random() < 0.4), 0.5)
            for east, north in {tuple(rng.integers(0, 5, 2)) for _ in range(8)}
        ]
        votes.add(vantage, votes_of_one)
        frame = FrameId(1, float(number))
        belief = belief.with_frame(vantage, frame, {v.cell: v.positive for v in votes_of_one})
    assert votes.roi == set(belief.roi)
    found, _ = votes.counted()
    counts = {Cell(*cell): (yes, count) for cell, _, yes, count, _ in found.values()}
    assert counts == {cell: tuple(tally) for cell, tally in belief.cells().items()}


def test_journal_holds_the_evidence() -> None:
    seen = FrameSeen(1, 1.0, HERE, (Vote(HERE, True, 0.8),))
    told = FrameWeighed(1, 1.0, (0.75,))
    assert from_json(to_json(told)) == told
    found = evidence_of([seen, told])
    assert found is not None
    assert (found.weight(HERE), found.is_roi(HERE, 0.5)) == (0.75, True)
    assert evidence_of([seen]) is None


# --- through the command -------------------------------------------------------------------------
def test_capture_that_was_saved_once_more_counts_once(good: Path, tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    shutil.copytree(good, photos)
    code, _, _ = mapped(photos, good, tmp_path / "one")
    assert code == 0
    image = paint(*PLACES[0], 0.0, seed=0)
    size = (image.width * 3 // 4, image.height * 3 // 4)
    shot(photos / "small.jpg", 0, PLACES[0], image=image.resize(size))
    shot(photos / "bright.jpg", 0, PLACES[0], image=image.point(lambda level: level * 9 // 10))
    shutil.copy(photos / "1.jpg", photos / "a copy.jpg")
    code, rows, summary = mapped(photos, good, tmp_path / "two")
    assert code == 0
    said = sorted(row["reason"] for row in rows.values() if row["reason"])
    assert [line.startswith("the same capture as") for line in said] == [True, True, False]
    assert said[2] == "the same file as 1.jpg"  # by name the last
    assert (summary["photographs_judged"], summary["photographs_twice"]) == (3, 3)
    one, two = (json.loads((tmp_path / n / "summary.json").read_text()) for n in ("one", "two"))
    assert one["pictures_per_cell"] == two["pictures_per_cell"]


def test_names_and_order_do_not_change_the_map(good: Path, tmp_path: Path) -> None:
    """All of one second: only the content of the files can order them."""
    for name, order in (("one", (0, 1, 2)), ("two", (2, 0, 1))):
        (tmp_path / name).mkdir()
        for number, which in enumerate(order):
            time = "2024:05:01 10:00:00"
            shot(tmp_path / name / f"{number}.jpg", which, PLACES[which], taken=time)
        assert mapped(tmp_path / name, good, tmp_path / f"map {name}")[0] == 0
    one, two = ((tmp_path / f"map {n}" / "map.geojson").read_bytes() for n in ("one", "two"))
    assert one == two


def test_map_has_the_beliefs_that_the_journal_gives(good: Path, tmp_path: Path) -> None:
    out = tmp_path / "map"
    _, _, summary = mapped(good, good, out)
    assert summary["decided_by"] == "evidence"
    features = json.loads((out / "map.geojson").read_text())["features"]
    told = [f["properties"] for f in features if f["properties"]["kind"] == "cell"]
    with Journal.open(out / "journal.jsonl") as journal:
        evidence = evidence_of(journal.events())
    assert evidence is not None
    for cell in told:
        named = Cell(cell["column"], cell["row"])
        assert cell["belief"] == round(evidence.belief(named), 3)
        assert (cell["state"] == "explored") == evidence.is_roi(named, 0.5)
    assert main(["animate", str(out), "--animate", str(tmp_path / "film.gif")]) == 0


SIDE = 100
PICTURE_BYTES = 6_000
KEPT_CELL_BYTES = 150
CELL_BYTES = 400


@contextmanager
def traced() -> Iterator[Callable[[], tuple[int, int]]]:
    """Yield the bytes held at the end of the block, and at most in it."""
    tracemalloc.start()
    try:
        yield tracemalloc.get_traced_memory
    finally:
        tracemalloc.stop()


def judged_pictures(folder: Path, spool: Spool) -> JudgedPictures:
    gathered = gather(open_source(folder))
    setting = setting_of(mission_of_text(derived(gathered), "derived"))
    return judge_pictures(gathered, setting, spool, Threads(1))


def test_pictures_leave_little_in_memory(tmp_path: Path) -> None:
    held = {}
    for count in (6, 6, 22):  # the first run loads modules as well
        folder = tmp_path / f"{count}"
        folder.mkdir(exist_ok=True)
        write_survey(folder, count, around=6)
        with Spool() as spool, traced() as memory:
            looked = judged_pictures(folder, spool)
            held[count] = memory()[0]
            assert len(looked.footings()) == count
    assert (held[22] - held[6]) / 16 < PICTURE_BYTES


def full(side: int) -> Evidence:
    """Return evidence of a square of cells, from pictures of a row each."""
    evidence, rng = Evidence(), np.random.default_rng(1)
    for _ in range(3):
        for east in range(side):
            cells = np.column_stack([np.full(side, east), np.arange(side)]).astype(np.int32)
            shares = rng.random(side).round(3)
            evidence.add_columns(cells, shares >= 0.5, shares, np.full(side, 0.8))
    return evidence


def test_evidence_takes_some_tens_of_bytes_a_cell() -> None:
    with traced() as memory:
        table, undecided = weighed(full(SIDE), 0.5)
        held, most = memory()
    assert (len(table), len(undecided)) == (SIDE**2, 0)
    assert held / len(table) < KEPT_CELL_BYTES
    assert most / len(table) < CELL_BYTES


def test_writers_of_cells_use_little_memory(tmp_path: Path) -> None:
    table, _ = weighed(full(SIDE), 0.5)
    sparse = np.arange(len(table)) % 97 == 0  # the long outline of a large region does not matter
    some = CellTable.judged(table.cells, sparse, table.positive, table.votes, table.belief)
    data = make_map()
    geojson.write(data, tmp_path / "warm")
    with traced() as memory:
        data = replace(data, cells=some)
        extent(data, 0.5, 0.5)
        geojson.write(data, tmp_path / "map.geojson")
        kml.write(data, tmp_path / "map.kml")
        most = memory()[1]
    assert most / len(table) < CELL_BYTES
