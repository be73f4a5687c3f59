"""The rig of flights with real autopilots, without one."""

from __future__ import annotations

import asyncio
import math
import subprocess
import sys
from dataclasses import replace

import pytest

from missions.geo.grid import Grid
from missions.units import GridPoint, LatLon
from tests.real.arducopter import ArduCopter
from tests.real.autopilot import Pad, Truth
from tests.real.px4 import Px4
from tests.real.referee import Referee
from tests.support.small_missions import mission, square

PROGRAM = "ardupilot/build/sitl/bin/arducopter"


def test_referee_vehicles_with_own_clocks_measures_their_distance():
    """Two vehicles 8 m apart, with clocks that began at different times, arrive in turn."""
    made = mission(square(-4, 10, 24, 16), square(-40, -40, 100, 110), vehicles=2)
    referee, grid = Referee(made), Grid.at(made.home, made.grid.cell_m)
    for arrived_s, number, booted_s in ((0.0, 0, 500.0), (0.1, 1, 20.0), (0.2, 0, 500.2)):
        truth = Truth(
            booted_s, grid.position(GridPoint(8.0 * number, 0.0)), made.start.amsl_m + 12.0,
            (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), arrived_s,
        )  # fmt: skip
        referee.watch(number, truth)
        assert referee.judge.nearest_m == math.inf  # the second has one place only
    referee.watch(1, replace(truth, position=grid.position(GridPoint(8.0, 0.0)), arrived_s=0.3))
    assert referee.judge.nearest_m == pytest.approx(8.0, abs=0.01)


def test_autopilot_process_has_ended_start_quotes_its_log(tmp_path):
    program = tmp_path / PROGRAM
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\necho bind failed on port 5501\nexit 3\n")
    program.chmod(0o755)

    async def begin() -> None:
        one = ArduCopter(program, Pad(0, LatLon(47.0, 8.0), 400.0, tmp_path), {})
        try:
            await one.start(1.0)
        finally:
            await one.stop()

    with pytest.raises(AssertionError, match="ended with 3: bind failed on port 5501"):
        asyncio.run(begin())


def test_px4_instance_is_locked_is_not_free(tmp_path, monkeypatch):
    monkeypatch.setattr(Px4, "lock", str(tmp_path / "lock-{}"))
    monkeypatch.setattr(Px4, "ports", ())
    (tmp_path / "lock-0").touch()  # left by a process that was killed
    assert Px4.free_instance(3) == 0
    hold = (
        "import fcntl, sys; file = open(sys.argv[1], 'w'); fcntl.lockf(file, fcntl.LOCK_EX); "
        "print('locked', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", hold, str(tmp_path / "lock-1")],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as holder:  # fmt: skip
        assert holder.stdout is not None
        assert holder.stdout.readline() == "locked\n"
        assert Px4.free_instance(3) == 2
        assert Px4.free_instance(1) == 0
        holder.communicate()


def test_arducopter_radio_fails_no_channel_is_overridden(tmp_path, monkeypatch):
    one = ArduCopter(tmp_path / PROGRAM, Pad(0, LatLon(47.0, 8.0), 400.0, tmp_path), {})
    asked: list[tuple[str, float, bool]] = []

    async def set_parameter(name: str, value: float) -> None:
        asked.append((name, value, one.pilot.sticks is None))

    monkeypatch.setattr(one.pilot, "set_parameter", set_parameter)
    one.hold_sticks(centred=True)
    asyncio.run(one.fail("radio"))
    assert one.pilot.sticks is None
    asyncio.run(one.fail("radio back"))
    assert one.pilot.sticks is not None
    assert asked == [("SIM_RC_FAIL", 1.0, True), ("SIM_RC_FAIL", 0.0, True)]
