"""A service on each aircraft, each a process of its own, that communicate by Zenoh."""

from __future__ import annotations

from pathlib import Path

import pytest

from missions.fleet_events import FactsShared, MemberReport
from tests.e2e.flights.test_fleet import journal, region
from tests.e2e.rig import LOOPBACK, ended, free_ports, roi_cells, simulator, started, uavmap
from tests.support.fleet_rig import field_text
from tests.support.small_missions import square
from uavmap.fleet.fleet_radio import START
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL

SPEEDUP = 8.0


def tiny(tmp_path: Path) -> Path:
    text = field_text(2, box=square(-6.0, 12.0, 28.0, 16.0), region=square(-2.0, 14.0, 20.0, 12.0))
    file = tmp_path / "tiny.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_two_services_map_a_region_together_over_zenoh(tmp_path):
    pytest.importorskip("zenoh", reason="the extra fleet is not installed")
    file, key = tiny(tmp_path), tmp_path / "fleet.key"
    assert uavmap("keys", "new", key).code == 0
    endpoint, other_end = (f"tcp/{LOOPBACK}:{free_ports(1)[1]}" for _ in range(2))
    common = ["--fleet-key", key, "--speedup", SPEEDUP, "--json"]
    folders = [tmp_path / "first", tmp_path / "second"]

    def onboard(number: int, url: str, *network: str) -> list[object]:
        where = ["--vehicle", number, "--connect", url, "--out", folders[number - 1]]
        return ["onboard", file, *where, *network, *common]

    with (
        simulator(str(file.with_suffix("")), speedup=SPEEDUP, vehicles=2) as urls,
        started(*onboard(1, urls[0], "--listen", endpoint)) as first,
        started(*onboard(2, urls[1], "--peer", endpoint, "--listen", other_end)) as second,
        started(
            *("fly", file, "--fleet", "--peer", endpoint, "--peer", other_end),
            *("--out", tmp_path / "ground", *common),
        ) as ground,
    ):
        done = [ended(first), ended(second), ended(ground)]
    assert [run.code for run in done] == [0, 0, 0], [run.err for run in done]
    assert all(run.summary["completed"] for run in done), [run.err for run in done]
    regions = [region(folder) for folder in (*folders, tmp_path / "ground")]
    assert regions[0] == regions[1] == regions[2]
    assert regions[0]
    for folder, other in zip(folders, (2, 1), strict=True):
        _, events = journal(folder)
        assert {e.vehicle for e in events if isinstance(e, MemberReport | FactsShared)} == {
            other
        }, [r.err for r in done]
        with Journal.open(folder / JOURNAL) as opened:
            assert opened.meta[START] > 1_600_000_000

    out = tmp_path / "both"
    whole = uavmap("merge", *folders, "--out", out, "--json")
    assert whole.code == 0, whole.err
    assert whole.summary["cells_roi"] == len(regions[0])
    assert whole.summary["exploration_s"] is None
    assert roi_cells(out) == {(cell.east, cell.north) for cell in regions[0]}
