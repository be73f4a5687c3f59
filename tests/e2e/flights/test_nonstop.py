"""Flights that do not stop: the same to the byte, killed on a path, recalled, over sockets."""

from __future__ import annotations

import json
import signal
from collections.abc import Sequence
from pathlib import Path

import pytest

from missions.events import from_json
from missions.flight.setting_of import setting_of
from missions.flight.step import step
from missions.orders import FlyPath, Look, Order
from missions.planning.kernels.jit import COMPILED
from tests.e2e import rig
from tests.e2e.journey import Journey
from uavmap.load.mission_source import load

SPEEDUP = 5.0
"""Speed at which a plan takes less than a second of the mission; places ahead are sent."""
STREAMED = 3.0
"""Highest speed at which setpoints are streamed, times real time."""
FRAMES = 10
"""Number of judged frames before a flight is stopped: it explores then."""
SWATH = ("--strategy", "swath")


def orders_of(name: str, lines: Sequence[str]) -> list[list[Order | None]]:
    made = load(rig.mission(name)).model_copy(update={"strategy": "swath"})
    setting = setting_of(made)
    state, told = setting.initial_state(), []
    for line in lines:
        state, _ = step(state, from_json(line))
        told.append([vehicle.order for vehicle in state.vehicles.values()])
    return told


def amid_a_path(flight: rig.Flight, name: str) -> int:
    """Return a number of events after which the first vehicle explores on a path."""
    lines = rig.bodies(flight.folder)
    told = orders_of(name, lines)
    seen = [json.loads(line)["kind"] == "frame_seen" for line in lines]
    on_path = [n for n, orders in enumerate(told) if seen[n] and isinstance(orders[0], FlyPath)]
    return on_path[len(on_path) * 2 // 3]


# --- in one process --------------------------------------------------------------------------
@pytest.mark.parametrize(("name", "vehicles"), [("tiny", 1), ("pair", 2), ("drift", 1)])
def test_nonstop_flight_is_complete_and_right(name, vehicles, tiny_passed, tmp_path):
    """The region of `drift` moves on, behind a hole in the fence."""
    flight = tiny_passed if name == "tiny" else rig.fly(name, tmp_path / "out", *SWATH)
    summary = flight.complete()
    assert (summary["vehicles"], summary["cells_undecided"]) == (vehicles, 0)
    assert summary["iou_cells"] > 0.75
    assert summary["bound_held"] is True
    if vehicles > 1:
        assert summary["min_separation_m"] >= 4.0


def test_nonstop_flight_is_quicker_than_a_look_over_every_cell(tiny, tiny_passed):
    assert tiny_passed.summary["exploration_s"] < 0.6 * tiny.summary["exploration_s"]
    assert tiny_passed.summary["makespan_s"] < tiny.summary["makespan_s"]
    assert rig.maps_alike(tiny.folder, tiny_passed.folder, 3)


def test_nonstop_flight_gives_no_look_order_and_frames_from_anywhere(tiny_passed):
    told = orders_of("tiny", rig.bodies(tiny_passed.folder))
    assert not any(isinstance(order, Look) for orders in told for order in orders)
    frames = rig.events(tiny_passed.folder, "frame_seen")
    assert all(frame["vantage"] is None for frame in frames)
    assert max(len(frame["votes"]) for frame in frames) > 5  # more than a cell and its neighbours


def test_mission_without_numba_is_complete(speck_passed, folder):
    """Plain Python plans with fewer moves: another path to the same map."""
    code = (
        "import sys; sys.modules['numba'] = None; from uavmap.ui.cli import main; sys.exit(main())"
    )
    words = ("fly", rig.mission("speck"), "--sim", "--json", *SWATH, "--out", folder)
    flight = rig.Flight(rig.python("-c", code, *words), folder)
    flight.complete()
    assert "swath plans slowly without numba" in flight.done.err
    assert rig.maps_alike(folder, speck_passed.folder)
    if COMPILED:
        assert rig.bodies(folder) != rig.bodies(speck_passed.folder)


def test_flight_killed_on_a_path_ends_like_an_undisturbed_one(tiny_passed, folder):
    whole = rig.bodies(tiny_passed.folder)
    arguments = ("fly", rig.mission("tiny"), "--sim", "--json", "--out", folder, *SWATH)
    count = amid_a_path(tiny_passed, "tiny")
    with rig.started(*arguments, stops_at=count) as process:
        rig.stop_after(process, folder, count, signal.SIGKILL)
    before = rig.bodies(folder)
    assert before == whole[: len(before)]
    done = rig.uavmap("resume", folder, "--json")
    assert done.code == 0, done.err
    assert rig.bodies(folder) == whole
    assert done.summary == {**tiny_passed.summary, "out": str(folder)}


# --- over sockets ----------------------------------------------------------------------------
def stopped_on_a_path(
    urls: list[str], folder: Path, number: signal.Signals, speedup: float
) -> rig.Finished | None:
    journey = Journey(folder, "speck", strategy="swath")
    with rig.started(*rig.flying(rig.mission("speck"), urls, folder, speedup, *SWATH)) as process:

        def there() -> bool:
            if process.poll() is not None:
                return True
            order = journey.vehicle().order
            return journey.frames > FRAMES and isinstance(order, FlyPath)

        rig.wait_until(there, "a path")
        assert process.poll() is None, process.communicate()
        process.send_signal(number)
        if number is signal.SIGKILL:
            process.communicate()
            return None
        return rig.ended(process)


@pytest.mark.parametrize(("autopilot", "speedup"), [("px4", SPEEDUP), ("ardupilot", STREAMED)])
def test_flight_killed_on_a_path_is_resumed_in_the_air(autopilot, speedup, speck_passed, folder):
    with rig.simulator("speck", speedup=speedup, autopilot=autopilot) as urls:
        stopped_on_a_path(urls, folder, signal.SIGKILL, speedup)
        before = rig.bodies(folder)
        done = rig.uavmap("resume", folder, "--json")
    done.completed()
    assert rig.bodies(folder)[: len(before)] == before
    again = rig.since_resumed(folder)
    (connected,) = (event for event in again[:3] if event["kind"] == "connected")
    assert connected["airborne"] is True
    assert sum(event["kind"] == "airborne" for event in rig.events(folder)) == 1
    assert rig.maps_alike(folder, speck_passed.folder)


def test_px4_returns_when_its_stream_ends_and_flies_again(speck_passed, folder, tmp_path):
    """Without setpoints a failsafe ends OFFBOARD.

    If it is still in the air when the service is back, the failsafe keeps it, and the next resume
    sends it out.
    """
    stickless = rig.kinder("speck", tmp_path, stick=False)
    with rig.simulator(stickless, speedup=STREAMED, autopilot="px4") as urls:
        stopped_on_a_path(urls, folder, signal.SIGKILL, STREAMED)
        before = rig.bodies(folder)
        done = rig.uavmap("resume", folder, "--json")
        if done.code == 3:
            assert "has landed, not under our control" in done.err
            done = rig.uavmap("resume", folder, "--json")
    done.completed()
    assert rig.bodies(folder)[: len(before)] == before
    # it was home, unless a quick machine resumed it before its failsafe acted
    assert sum(event["kind"] == "airborne" for event in rig.events(folder)) in (1, 2)
    assert rig.maps_alike(folder, speck_passed.folder)


def test_control_c_on_a_path_returns_and_resume_flies_again(speck_passed, folder):
    with rig.simulator("speck", speedup=SPEEDUP, autopilot="px4") as urls:
        stopped = stopped_on_a_path(urls, folder, signal.SIGINT, SPEEDUP)
        assert stopped is not None
        assert stopped.code == 3, stopped.err
        assert stopped.summary["completed"] is False
        kinds = [event["kind"] for event in rig.events(folder)]
        assert "landed" in kinds[kinds.index("recalled") :]
        assert not {"guarded", "order_failed", "overridden"} & set(kinds)
        before = rig.bodies(folder)
        done = rig.uavmap("resume", folder, "--json", *rig.arguments_of(urls))
    done.completed()
    assert rig.bodies(folder)[: len(before)] == before
    assert rig.maps_alike(folder, speck_passed.folder)


def test_two_vehicles_over_sockets_complete(tiny_passed, folder):
    with rig.simulator("tiny", speedup=SPEEDUP, vehicles=2) as urls:
        done = rig.uavmap(
            *rig.flying(rig.mission("tiny"), urls, folder, SPEEDUP, *SWATH, "--vehicles", 2)
        )
    done.completed()
    assert {event["vehicle"] for event in rig.events(folder, "landed")} == {1, 2}
    assert rig.maps_alike(folder, tiny_passed.folder)
