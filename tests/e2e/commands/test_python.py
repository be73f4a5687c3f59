"""uavmap from Python: flights as by the command, in scripts, notebooks and asyncio programs."""

from __future__ import annotations

import asyncio
import importlib
import inspect
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
import shapely

import uavmap
from tests.e2e.rig import events, mission, python, simulator, wait_for

SPEEDUP = 20.0


# --- in the simulator ----------------------------------------------------------------------------
def test_flight_equals_that_of_the_command_also_inside_a_running_loop(speck, tmp_path):
    async def notebook() -> uavmap.Results:
        return uavmap.fly(mission("speck"), sim=True, out=tmp_path / "out", quiet=True)

    flight = asyncio.run(notebook())

    assert flight.folder == tmp_path / "out"
    assert (flight.folder / "map.geojson").read_bytes() == (
        speck.folder / "map.geojson"
    ).read_bytes()
    assert flight.summary == {k: v for k, v in speck.summary.items() if k != "out"}
    assert flight.completed
    assert flight.aircraft_down == ()
    assert isinstance(flight.region, shapely.Polygon)
    assert flight.region_utm.area == pytest.approx(flight.area_m2, rel=2e-3)


def test_loop_continues_during_a_flight_and_cancelling_ends_it(tmp_path):
    beats = 0

    async def program() -> None:
        nonlocal beats
        flying = asyncio.ensure_future(
            uavmap.fly_async(mission("speck"), sim=True, speedup=20.0, out=tmp_path / "out")
        )
        while not events(tmp_path / "out", "frame_seen"):
            assert not flying.done()
            await asyncio.sleep(0.01)
            beats += 1
        flying.cancel()
        with pytest.raises(asyncio.CancelledError):
            await flying

    asyncio.run(program())
    assert beats > 5
    assert not uavmap.open_results(tmp_path / "out").completed  # its map so far
    (tmp_path / "out" / "map.geojson").unlink()
    with pytest.raises(uavmap.ResultsError, match=r"no map.geojson.*uavmap resume"):
        uavmap.open_results(tmp_path / "out")


def test_errors_are_those_of_the_command(tmp_path):
    with pytest.raises(uavmap.MissionFileError, match="did you mean 'runway'"):
        uavmap.fly("runwya", sim=True)
    with pytest.raises(uavmap.LinkError, match="no vehicle to fly"):
        uavmap.fly(mission("speck"))
    with pytest.raises(uavmap.LinkError, match="nosuch"):
        uavmap.fly(mission("speck"), connect="nosuch://1", yes=True, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
    with pytest.raises(uavmap.JournalError):
        uavmap.resume(tmp_path)
    with pytest.raises(uavmap.UavmapError, match="seed = -1"):
        uavmap.fly(mission("speck"), sim=True, seed=-1)
    with pytest.raises(uavmap.UavmapError, match="quiet=True hides the question"):
        uavmap.fly(mission("speck"), connect="udpin://127.0.0.1:1", quiet=True)


# --- aircraft at the end of a link ---------------------------------------------------------------
def once_it_flies(folder: Path, act: Callable[[], None]) -> threading.Thread:
    def watch() -> None:
        wait_for(folder, "lifted_off")
        act()

    thread = threading.Thread(target=watch)
    thread.start()
    return thread


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def came_home(folder: Path) -> bool:
    return bool(events(folder, "recalled")) and bool(events(folder, "landed"))


def test_control_c_and_cancellation_bring_the_vehicle_home(tmp_path):
    """One after the other with the same simulated aircraft: the simulator starts slowly.

    Ctrl-C without a running loop, a cancelled task, and SIGTERM with a running loop; then it is
    finished.
    """
    first, second = tmp_path / "first", tmp_path / "second"
    with simulator("speck", speedup=SPEEDUP) as urls:
        before = signal.getsignal(signal.SIGINT)
        watching = once_it_flies(first, interrupt)
        with pytest.raises(KeyboardInterrupt, match="results are in its folder"):
            uavmap.fly(mission("speck"), connect=urls, speedup=SPEEDUP, out=first)
        watching.join()
        assert came_home(first)
        assert signal.getsignal(signal.SIGINT) is before
        assert not uavmap.open_results(first).completed

        async def program() -> None:
            flying = asyncio.ensure_future(
                uavmap.fly_async(mission("speck"), connect=urls, speedup=SPEEDUP, out=second)
            )
            await asyncio.to_thread(once_it_flies(second, lambda: None).join)
            flying.cancel()
            with pytest.raises(asyncio.CancelledError):
                await flying

        asyncio.run(program())
        assert came_home(second)
        finished = uavmap.resume(second, quiet=True)
        assert finished.completed


def test_second_control_c_leaves_the_vehicle_to_its_autopilot(folder):
    """Over `runway` and not too fast: the second press comes while it flies, or lands."""

    def twice() -> None:
        wait_for(folder, "frame_seen")
        interrupt()
        wait_for(folder, "recalled")
        interrupt()

    async def notebook() -> None:
        uavmap.fly(mission("runway"), connect=urls, speedup=SPEEDUP / 2, out=folder)

    with simulator("runway", speedup=SPEEDUP / 2) as urls:
        watching = threading.Thread(target=twice)
        watching.start()
        with pytest.raises(uavmap.AircraftError, match=r"left to its autopilot in (RTL|LAND)"):
            asyncio.run(notebook())
        watching.join()


# --- what importing costs ------------------------------------------------------------------------
def test_importing_uavmap_loads_nothing_heavy():
    code = (
        "import sys, uavmap\n"
        "heavy = {'numpy', 'pydantic', 'asyncio', 'shapely', 'missions'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = python("-c", code)
    assert (done.code, done.err) == (0, "")


def test_public_names_are_there_and_a_package_shadows_none():
    assert set(uavmap.__all__) <= set(dir(uavmap))
    assert all(getattr(uavmap, name) is not None for name in uavmap.__all__)
    with pytest.raises(AttributeError, match="no attribute 'flz'"):
        getattr(uavmap, "flz")  # noqa: B009 - a type checker would see it
    package = importlib.import_module("uavmap.runner.operator.interrupts")
    assert uavmap.runner.operator.interrupts is package  # type: ignore[attr-defined]
    parameters = inspect.signature(uavmap.fly).parameters
    assert parameters["sim"].default is False
    assert list(parameters) == list(inspect.signature(uavmap.fly_async).parameters)
