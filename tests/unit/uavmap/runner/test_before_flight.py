"""Check, show, ask, set: findings that keep a mission on the ground, and the operator's yes."""

from __future__ import annotations

import asyncio
import os
import pty
from pathlib import Path

import cv2
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import NotFlownError, PreflightError
from missions.flight.setting_of import setting_of
from missions.mission.schema import Battery, Mission
from missions.mission.sim_section import SimFault
from tests.support.field import BOTH, Field, mission_of, on_field
from tests.support.running import by
from tests.support.small_missions import at_heights, with_receivers
from uavmap.base.messages import shown_on
from uavmap.mavlink.vehicle_view import EKF_ABSOLUTE, VehicleView
from uavmap.runner.before_flight import BeforeFlight
from uavmap.runner.operator.company import Preflight
from uavmap.runner.operator.ground_crew import Operator
from uavmap.runner.preflight.autopilot_setup import FILE


def before(
    field: Field, folder: Path, *, yes: bool = False, dry: bool = False, keep: bool = False
) -> BeforeFlight:
    wanted = Preflight(yes, dry).options(field.setting)
    ask = Operator().ask
    return BeforeFlight(wanted, field.setting, folder, field.links, ask, keep_fence=keep)


def real(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the simulated vehicles count as real ones."""
    monkeypatch.setattr(VehicleView, "is_simulator", property(lambda view: False))


def fault_of(kind: str) -> SimFault:
    return SimFault.model_validate({"vehicle": 1, "at_s": 0.0, "kind": kind})


def finding_of(field: Field, what: str) -> str:
    """Return the last finding about a subject."""
    lines = [x for text in field.lines for x in text.split("\n") if f" 1 {what}: " in x]
    return lines[-1]


@pytest.mark.parametrize("autopilot", BOTH)
def test_vehicle_that_was_just_switched_on_is_waited_for(autopilot, tmp_path):
    async def body(field: Field) -> None:
        flight = before(field, tmp_path)
        assert field.links[0].session.view.ekf_flags & EKF_ABSOLUTE == 0
        with pytest.raises(NotFlownError) as dry:
            await before(field, tmp_path, dry=True).prepare()
        assert dry.value.could_fly, field.lines
        await flight.restore()

    on_field(body, mission_of(autopilot), ready_s=0.0)


@pytest.mark.parametrize("autopilot", BOTH)
@by(on_field, mission_of)
async def test_simulator_is_shown_and_set_up_without_a_question(field, /, autopilot, tmp_path):
    flight = before(field, tmp_path)
    await flight.prepare()
    assert "a box of about" in field.lines[0]
    name = {"ardupilot": "ArduPilot 4.6.0", "px4": "PX4 1.15.4"}[autopilot]
    assert f"{name}, the bundled simulator" in finding_of(field, "autopilot")
    assert finding_of(field, "GPS") == "ok    1 GPS: a 3D fix, 10 satellites, HDOP 1.2"
    assert "0.0 % lost" in finding_of(field, "link")
    assert "ready to arm" in finding_of(field, "EKF")
    assert "set and read back" in finding_of(field, "fence")
    picture = cv2.imread(str(tmp_path / "test-picture-1.png"))
    assert picture is not None
    assert field.count(0, mav.MAV_MISSION_TYPE_FENCE) == 4
    await flight.restore()
    assert field.count(0, mav.MAV_MISSION_TYPE_FENCE) == 0


@by(on_field, lambda: mission_of("ardupilot"))
async def test_question_without_an_operator_counts_as_no(field, /, tmp_path, monkeypatch):
    real(monkeypatch)
    with pytest.raises(PreflightError, match="give --yes"):
        await before(field, tmp_path).prepare()
    assert field.count(0, mav.MAV_MISSION_TYPE_FENCE) == 0
    await before(field, tmp_path, yes=True).prepare()
    assert field.count(0, mav.MAV_MISSION_TYPE_FENCE) == 4


@by(on_field, lambda: mission_of("ardupilot"))
async def test_vehicle_already_in_the_air_is_reported(field, /, tmp_path):
    for command, *params in ((176, 1, 4), (400, 1), (22, 0, 0, 0, 0, 0, 0, 25)):
        filled = (*params, *([0.0] * (7 - len(params))))
        field.ask(0, mav.MAVLink_command_long_message(1, 1, command, 0, *filled))
    await asyncio.sleep(30.0)
    found = await before(field, tmp_path)._examined(1)
    (line,) = [f.line() for f in found if f.what == "vehicle"]
    assert line.startswith("warn  1 vehicle: armed, 25 m up, in GUIDED (wanted: on the ground")


@pytest.mark.parametrize("vehicles", [1, 3])
@by(on_field, lambda vehicles: mission_of("ardupilot", vehicles))
async def test_dry_run_sets_all_and_arms_nothing(field, /, vehicles, tmp_path):
    flight = before(field, tmp_path, dry=True)
    with pytest.raises(NotFlownError) as over:
        await flight.prepare()
    assert over.value.could_fly
    assert sum("set and read back" in text for text in field.lines) == 1
    assert not (tmp_path / FILE).exists()
    assert not any(vehicle.truth.armed for vehicle in field.vehicles)


@pytest.mark.parametrize("autopilot", BOTH)
@by(
    on_field,
    lambda autopilot: at_heights(with_receivers(mission_of(autopilot, 2), 0.0), (0.0, -6.0)),
)
async def test_return_heights_of_a_team_are_apart_at_any_heights_of_homes(
    field, /, autopilot, tmp_path
):
    """Layers above each own home put two of them, 6 m apart in height, into the same air."""
    views = [link.session.view for link in field.links]
    assert views[0].home_amsl_m - views[1].home_amsl_m == pytest.approx(6.0, abs=0.1)
    await before(field, tmp_path, yes=True).prepare()
    name, scale = ("RTL_ALT", 100.0) if autopilot == "ardupilot" else ("RTL_RETURN_ALT", 1.0)
    above_sea_m = [
        view.home_amsl_m + field.parameter(i, name) / scale for i, view in enumerate(views)
    ]
    assert above_sea_m[1] - above_sea_m[0] == pytest.approx(6.0, abs=0.1)
    ceiling = "FENCE_ALT_MAX" if autopilot == "ardupilot" else "GF_MAX_VER_DIST"
    assert field.parameter(1, ceiling) >= 24.0 + 10.0


def test_empty_battery_refuses_the_flight(tmp_path, monkeypatch):
    real(monkeypatch)
    weak = Battery(capacity_wh=4000.0, hover_power_w=300.0, reserve=0.98)

    async def body(field: Field) -> None:
        field.vehicles[0]._battery.energy_wh = 2000.0
        await asyncio.sleep(3.0)
        with pytest.raises(PreflightError, match=r"bad   1 battery: \d+ %.*put a charged battery"):
            await before(field, tmp_path, yes=True).prepare()

    on_field(body, mission_of("ardupilot", battery=weak))


@pytest.mark.parametrize(
    ("kind", "why"), [("camera_stall", "none came"), ("camera_corrupt", "picture")]
)
@by(on_field, lambda kind: mission_of("ardupilot", faults=(fault_of(kind),)))
async def test_camera_without_pictures_refuses_the_flight(field, /, kind, why, tmp_path):
    with pytest.raises(PreflightError, match="not flown:\nbad   1 camera: ") as error:
        await before(field, tmp_path, yes=True).prepare()
    assert why in str(error.value)
    assert not any("bad   1 camera" in text for text in field.lines), "it is told once"
    flight = before(field, tmp_path, dry=True)
    with pytest.raises(NotFlownError) as over:
        await flight.prepare()
    assert not over.value.could_fly


@by(on_field, lambda: mission_of("ardupilot"))
async def test_kept_fence_that_the_mission_leaves_is_refused(field, /, tmp_path):
    field.put(0, "FENCE_ENABLE", 1)
    await before(field, tmp_path, keep=True).prepare()
    assert "kept: 0 items" in finding_of(field, "fence")
    assert field.count(0, mav.MAV_MISSION_TYPE_FENCE) == 0
    field.put(0, "FENCE_RADIUS", 15)
    with pytest.raises(PreflightError, match="leaves the one that is set: search"):
        await before(field, tmp_path, keep=True).prepare()


@by(on_field, lambda: mission_of("ardupilot", faults=(fault_of("gps"),)))
async def test_vehicle_without_a_fix_has_findings_that_name_it(field, /, tmp_path):
    with pytest.raises(NotFlownError) as over:
        await before(field, tmp_path, dry=True).prepare()
    assert not over.value.could_fly
    assert finding_of(field, "GPS").startswith(
        "bad   1 GPS: no fix, 0 satellites (wanted: a 3D fix"
    )
    assert finding_of(field, "EKF").startswith("bad   1 EKF: no position yet")


@by(on_field, lambda: mission_of("ardupilot"))
async def test_resumed_flight_asks_no_question(field, /, tmp_path, monkeypatch):
    real(monkeypatch)
    goes_on = BeforeFlight(None, field.setting, tmp_path, field.links, Operator().ask)
    await goes_on.prepare()
    assert field.count(0, mav.MAV_MISSION_TYPE_FENCE) == 4
    await goes_on.restore()
    (tmp_path / FILE).write_text("damaged", "utf-8")
    await goes_on.prepare()
    assert field.lines[-1].startswith(f"{tmp_path / FILE} cannot be read")
    await goes_on.restore()
    assert "the settings of the mission stay" in field.lines[-1]


# --- the question ----------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("typed", "answer"), [("y\n", True), ("YES\n", True), ("n\n", False), ("\n", False)]
)
def test_answer_other_than_yes_counts_as_no(typed, answer):
    ours, theirs = pty.openpty()
    with os.fdopen(theirs, "r") as stream:

        async def main() -> bool | None:
            with shown_on(Answers()):
                return await Operator(stream).ask("fly? [y/N]")

        class Answers:
            def show(self, text: str) -> None:
                os.write(ours, typed.encode())

        assert asyncio.run(main()) is answer
    os.close(ours)


def simulated(autopilot: str, second_m: float, sigma_m: float) -> Mission:
    """Return a mission of two whose second pad has this height, with receivers of this error."""
    return at_heights(with_receivers(mission_of(autopilot, 2), sigma_m), (0.0, second_m))


def line_of(mission: Mission, given_m: float, folder: Path) -> str:
    """Return the preflight line of the second home if its mission gives this height."""

    async def body(field: Field) -> None:
        field.setting = setting_of(at_heights(mission, (0.0, given_m)))
        with pytest.raises(NotFlownError):
            await before(field, folder, dry=True).prepare()

    lines = "\n".join(on_field(body, mission).field.lines).split("\n")
    (found,) = [line for line in lines if "home height: " in line]
    return found


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize(("given_m", "level"), [(8.0, "ok"), (6.5, "warn"), (0.0, "bad")])
def test_pad_heights_receivers_contradict_the_mission(autopilot, given_m, level, tmp_path):
    assert line_of(simulated(autopilot, 8.0, 0.0), given_m, tmp_path).startswith(f"{level:<5} 2 ")


@pytest.mark.parametrize("autopilot", BOTH)
def test_pad_heights_receivers_are_believed_within_their_errors(autopilot, tmp_path):
    assert line_of(simulated(autopilot, 0.0, 3.0), 0.0, tmp_path).startswith("ok    2 ")


def test_pad_heights_contradicted_keep_the_team_on_the_ground(tmp_path):
    mission = simulated("ardupilot", 8.0, 0.0)

    async def body(field: Field) -> None:
        field.setting = setting_of(at_heights(mission, (0.0, 0.0)))
        with pytest.raises(PreflightError, match=r"home height: .*set vehicles.1..home_height_m"):
            await before(field, tmp_path, yes=True).prepare()

    on_field(body, mission)
