"""What a replay keeps in memory: a few kilobytes a picture, some hundred bytes a cell."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from missions.flight.setting_of import setting_of
from missions.mapping.evidence import Evidence
from tests.benchmarks.photos.many_pictures import write_survey
from tests.unit.uavmap.output.maps import make_map
from uavmap.load.mission_source import mission_of_text
from uavmap.output.facts.extent import extent
from uavmap.output.facts.map_model import CellTable
from uavmap.output.facts.vote_tally import weighed
from uavmap.output.formats import geojson_encoder as geojson
from uavmap.output.formats import kml_encoder as kml
from uavmap.photos.mission_from_photos import derived
from uavmap.photos.picture_replay import Looked, look_at_all
from uavmap.photos.scratch_file import Spool
from uavmap.photos.sources.inventory import gather, open_source
from uavmap.photos.workers import Threads

SIDE = 100
PICTURE_BYTES = 6_000
KEPT_CELL_BYTES = 150
CELL_BYTES = 400


@contextmanager
def traced() -> Iterator[Callable[[], tuple[int, int]]]:
    """Bytes that are held, and that were at most, since the block has begun."""
    tracemalloc.start()
    try:
        yield tracemalloc.get_traced_memory
    finally:
        tracemalloc.stop()


def looked_at(folder: Path, spool: Spool) -> Looked:
    gathered = gather(open_source(folder))
    setting = setting_of(mission_of_text(derived(gathered), "derived"))
    return look_at_all(gathered, setting, spool, Threads(1))


def test_pictures_leave_little_in_memory(tmp_path: Path) -> None:
    held = {}
    for count in (6, 6, 22):  # the first time modules are loaded, too
        folder = tmp_path / f"{count}"
        folder.mkdir(exist_ok=True)
        write_survey(folder, count, around=6)
        with Spool() as spool, traced() as memory:
            looked = looked_at(folder, spool)
            held[count] = memory()[0]
            assert len(looked.footings()) == count
    assert (held[22] - held[6]) / 16 < PICTURE_BYTES


def full(side: int) -> Evidence:
    """Evidence of a square of cells, from pictures of a row each."""
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


def test_who_writes_cells_takes_some_at_a_time(tmp_path: Path) -> None:
    table, _ = weighed(full(SIDE), 0.5)
    sparse = np.arange(len(table)) % 97 == 0  # a large region has a long outline: no matter here
    some = CellTable.judged(table.cells, sparse, table.positive, table.votes, table.belief)
    data = make_map()
    geojson.write(data, tmp_path / "warm")
    with traced() as memory:
        data = replace(data, cells=some)
        extent(data, 0.5)
        geojson.write(data, tmp_path / "map.geojson")
        kml.write(data, tmp_path / "map.kml")
        most = memory()[1]
    assert most / len(table) < CELL_BYTES
