"""A simulated flight is killed again and again; committed events stay, and the map is the same.

The moments are drawn by seed, in events of the journal, and are met by watching it grow.
"""

from __future__ import annotations

import json
import shutil
import signal
from dataclasses import replace

import numpy as np
import pytest

from tests.e2e import rig
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import FlightPlan


def moments(seed: int, count: int, last: int) -> list[int]:
    rng = np.random.default_rng(seed)
    return sorted(int(n) for n in rng.choice(np.arange(2, last - 10), size=count, replace=False))


def begin_and_stop(folder, count, number=signal.SIGKILL, *more):
    with rig.started(
        "fly", rig.mission("speck"), "--sim", "--json", "--out", folder, *more, stops_at=count
    ) as process:
        return rig.stop_after(process, folder, count, number)


def test_flight_killed_again_and_again_ends_like_an_undisturbed_one(speck, folder):
    whole = rig.bodies(speck.folder)
    first, *others = moments(4, 3, len(whole))
    begin_and_stop(folder, first)
    for moment in others:
        before = rig.bodies(folder)
        assert before == whole[: len(before)]
        # the journal does not grow before the recorded part has been flown again
        count = max(moment, len(before) + 1)
        with rig.started("resume", folder, "--json", stops_at=count) as process:
            rig.stop_after(process, folder, count, signal.SIGKILL)
    done = rig.uavmap("resume", folder, "--json")
    assert done.code == 0
    assert rig.bodies(folder) == whole
    assert rig.roi_cells(folder) == rig.roi_cells(speck.folder)
    assert done.summary == {**speck.summary, "out": str(folder)}
    assert (folder / "flight.tlog").read_bytes() == (speck.folder / "flight.tlog").read_bytes()
    assert (folder / "map.png").read_bytes() == (speck.folder / "map.png").read_bytes()


def test_resume_from_home_keeps_all_frames(speck, folder):
    whole = rig.bodies(speck.folder)
    begin_and_stop(folder, len(whole) // 2)
    before = rig.bodies(folder)
    done = rig.uavmap("resume", folder, "--from-home", "--json")
    done.completed()
    assert done.summary["cells_missed"] == 0
    assert done.summary["fence_breaches"] == done.summary["reserve_violations"] == 0
    after = rig.bodies(folder)
    assert after[: len(before)] == before
    assert json.loads(after[len(before)])["kind"] == "resumed"
    with Journal.open(folder / "journal.jsonl") as journal:
        assert FlightPlan.read(journal).rehomed
        assert journal.meta["plan"]["rehomed"] is False  # the plan itself never changes
    # the world is the same, another gust blows: cells at the rim may come out otherwise
    assert rig.maps_alike(folder, speck.folder)


def assert_resumable_with_a_map(stopped, folder):
    assert f"to continue: uavmap resume {folder}" in stopped.err
    assert f"the map so far is in {folder}" in stopped.err
    assert {"map.geojson", "map.gpkg", "map.kml", "map.png", "report.html", "summary.json"} < {
        path.name for path in folder.iterdir()
    }
    assert json.loads((folder / "summary.json").read_text())["completed"] is False


def test_control_c_stops_a_simulated_flight_and_resume_continues(speck, folder):
    whole = rig.bodies(speck.folder)
    # paced, so that it is still in the air when the signal comes, on a busy machine as well
    stopped = begin_and_stop(folder, len(whole) // 4, signal.SIGINT, "--speedup", 8)
    assert stopped is not None
    assert stopped.code == 130
    assert stopped.out == ""
    assert stopped.err.splitlines()[-1].startswith("uavmap: ")
    assert_resumable_with_a_map(stopped, folder)
    with rig.started("resume", folder, "--json") as process:
        done = rig.ended(process)
    assert done.code == 0
    assert rig.bodies(folder) == whole


def test_simulated_flight_with_two_sigterms_leaves_its_map(folder):
    with rig.started(
        "fly", rig.mission("speck"), "--sim", "--speedup", 15, "--json", "--out", folder
    ) as process:
        rig.wait_for(folder, "frame_seen")
        process.send_signal(signal.SIGTERM)
        said = ""
        while "to continue" not in said:
            said += process.stderr.readline()
        process.send_signal(signal.SIGTERM)
        stopped = rig.ended(process)
    assert (stopped.code, stopped.out) == (130, "")
    assert_resumable_with_a_map(replace(stopped, err=said + stopped.err), folder)


def test_resuming_a_finished_mission_writes_its_results_anew(speck, folder):
    shutil.copytree(speck.folder, folder)
    for name in ("map.png", "map.kml", "map.geojson", "summary.json"):
        (folder / name).unlink()
    done = rig.uavmap("resume", folder, "--json")
    assert done.code == 0
    assert rig.bodies(folder) == rig.bodies(speck.folder)
    for name in ("map.png", "map.kml", "map.geojson"):
        assert (folder / name).read_bytes() == (speck.folder / name).read_bytes()
    assert done.summary["cells_roi"] == speck.summary["cells_roi"]


@pytest.mark.parametrize("room_bytes", [1_000, 10_000, 50_000])
def test_flight_with_a_full_disk_twice_and_resumed_ends_like_an_undisturbed_one(
    room_bytes, speck, tmp_path
):
    whole, folder = rig.bodies(speck.folder), tmp_path / "out"
    words = ["fly", rig.mission("speck"), "--sim", "--json", "--out", folder]
    confirmed = 0
    for _ in range(2):
        with rig.started(*words, room_bytes=room_bytes) as process:
            assert rig.ended(process).code in (0, 2)
        kept = rig.bodies(folder)
        assert kept == whole[: len(kept)]
        assert len(kept) >= confirmed
        confirmed = len(kept)
        if (folder / "journal.jsonl").exists():
            words = ["resume", folder, "--json"]
    assert rig.uavmap(*words).code == 0
    assert rig.bodies(folder) == whole
    for name in ("map.geojson", "map.kml", "map.png"):
        assert (folder / name).read_bytes() == (speck.folder / name).read_bytes()


def test_damaged_journal_is_recovered_and_the_flight_ends_like_an_undisturbed_one(speck, folder):
    shutil.copytree(speck.folder, folder)
    path = folder / "journal.jsonl"
    data = bytearray(path.read_bytes())
    middle = data.rindex(b'"kind":"tracked"', 0, len(data) // 2)
    data[middle + 9] ^= 1
    path.write_bytes(data)
    refused = rig.uavmap("resume", folder)
    assert refused.code == 2
    (line,) = refused.err.splitlines()
    assert f"`uavmap resume {folder} --recover`" in line
    assert path.read_bytes() == data
    done = rig.uavmap("resume", folder, "--recover", "--json")
    assert done.code == 0
    assert "events are kept, at least" in done.err
    assert rig.bodies(folder) == rig.bodies(speck.folder)
    assert (folder / "journal.damaged-1.jsonl").read_bytes() == data
    assert (folder / "map.png").read_bytes() == (speck.folder / "map.png").read_bytes()
    again = rig.uavmap("resume", folder, "--recover", "--json")
    assert again.code == 0
    assert "nothing to recover" in again.err
