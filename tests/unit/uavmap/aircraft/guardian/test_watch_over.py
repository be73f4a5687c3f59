"""Every end of a mission first brings its aircraft home."""

import asyncio

import pytest

from missions.errors import AircraftError, JournalError
from tests.support.running import by, on_virtual_time
from uavmap.aircraft.guardian.last_watch import Guardians, run_with_keeper
from uavmap.base.clock import VirtualClock, run


class Kept:
    def __init__(self, *, takes_s=30.0, fate=""):
        self.commands = []
        self.home = False
        self.running = False
        self._takes_s = takes_s
        self._fate = fate

    async def run(self):
        self.running = True
        try:
            await asyncio.Event().wait()
        finally:
            self.running = False

    async def bring_home(self, reason):
        assert self.running
        self.commands.append(("home", reason, asyncio.get_running_loop().time()))
        await asyncio.sleep(self._takes_s)
        self.home = True

    async def leave(self, reason):
        assert self.running
        self.commands.append(("leave", reason, asyncio.get_running_loop().time()))

    def fate(self):
        return self._fate


async def watched(kept, mission, *, leave):
    await run_with_keeper(Guardians(dict(enumerate(kept, start=1))), mission, leave=leave)


async def failing(after_s, failure):
    await asyncio.sleep(after_s)
    raise failure


@by(on_virtual_time)
async def test_mission_that_fails_ends_when_all_vehicles_are_home():
    kept = [Kept(), Kept(takes_s=50.0)]
    loop = asyncio.get_running_loop()
    with pytest.raises(JournalError, match="disk is full"):
        await watched(kept, failing(10.0, JournalError("disk is full")), leave=True)
    assert loop.time() == pytest.approx(60.0)
    assert len(asyncio.all_tasks()) == 1
    assert all(k.home and not k.running for k in kept)
    assert all("disk is full" in reason for k in kept for _, reason, _ in k.commands)


def test_vehicle_not_at_home_at_the_end_is_named():
    kept = [Kept(), Kept(fate="on the ground 40 m from home")]
    with pytest.raises(AircraftError, match="vehicle 2: on the ground 40 m from home"):
        run(watched(kept, failing(1.0, JournalError("full")), leave=True), VirtualClock())


class Defective(Kept):
    async def bring_home(self, reason):
        await asyncio.sleep(0.1)
        raise ValueError("a defect in the geometry of its return path")


@by(on_virtual_time)
async def test_watched_over_one_guardian_fails_others_come_home():
    """Its aircraft is left to its autopilot; all errors are raised, with its fate."""
    kept = [Defective(fate="left to its autopilot in RTL"), Kept()]
    with pytest.raises(ExceptionGroup) as failed:
        await watched(kept, failing(1.0, RuntimeError("a defect of a strategy")), leave=True)
    assert kept[1].home
    assert [word for word, _, _ in kept[0].commands] == ["leave"]
    assert failed.group_contains(RuntimeError)
    assert failed.group_contains(ValueError)
    assert failed.value.__notes__ == ["vehicle 1: left to its autopilot in RTL"]


@by(on_virtual_time)
async def test_watched_over_one_guardian_fails_after_the_mission_others_come_home():
    kept = [Defective(), Kept()]
    with pytest.raises(ExceptionGroup):
        await watched(kept, asyncio.sleep(1.0), leave=True)
    assert kept[1].home


@by(on_virtual_time)
async def test_interrupt_leaves_the_return_to_the_autopilot():
    kept = [Kept(fate="left to its autopilot in RTL")]
    flying = asyncio.ensure_future(watched(kept, asyncio.sleep(1e6), leave=True))
    await asyncio.sleep(5.0)
    flying.cancel()
    with pytest.raises(AircraftError, match="left to its autopilot in RTL"):
        await flying
    assert [what for what, _, _ in kept[0].commands] == ["leave"]


@by(on_virtual_time)
async def test_interrupt_during_the_return_leaves_it_to_the_autopilot():
    kept = [Kept(takes_s=1000.0, fate="left to its autopilot in RTL")]
    failure = JournalError("full")
    flying = asyncio.ensure_future(watched(kept, failing(1.0, failure), leave=True))
    await asyncio.sleep(5.0)
    flying.cancel()
    with pytest.raises(AircraftError):
        await flying
    assert asyncio.get_running_loop().time() == pytest.approx(5.0)
    assert [what for what, _, _ in kept[0].commands] == ["home", "leave"]


def test_guardian_that_fails_ends_the_mission_loudly():
    class Broken(Kept):
        async def run(self):
            self.running = True
            await asyncio.sleep(3.0)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run(watched([Broken()], asyncio.sleep(1e6), leave=True), VirtualClock())


@by(on_virtual_time)
async def test_third_interrupt_still_names_the_aircraft():
    class Slow(Kept):
        async def leave(self, reason):
            await super().leave(reason)
            await asyncio.sleep(15.0)

    kept = [Slow(fate="left to its autopilot in RTL")]
    flying = asyncio.ensure_future(watched(kept, asyncio.sleep(1e6), leave=True))
    for _ in range(2):
        await asyncio.sleep(5.0)
        flying.cancel()
    with pytest.raises(AircraftError, match="vehicle 1: left to its autopilot in RTL"):
        await flying
    assert asyncio.get_running_loop().time() == pytest.approx(10.0)


def test_defect_keeps_its_traceback_and_names_vehicles_not_at_home():
    kept = [Kept(), Kept(fate="on the ground 40 m from home")]
    with pytest.raises(ZeroDivisionError) as caught:
        run(watched(kept, failing(1.0, ZeroDivisionError()), leave=True), VirtualClock())
    assert caught.value.__notes__ == ["vehicle 2: on the ground 40 m from home"]
    assert all(guardian.home for guardian in kept)
