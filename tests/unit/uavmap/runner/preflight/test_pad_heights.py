"""Homes of a team: receivers contradict the mission, or they do not."""

from __future__ import annotations

from pathlib import Path

import pytest

from missions.errors import NotFlownError, PreflightError
from missions.flight.setting_of import setting_of
from missions.mission.schema import Mission
from tests.support.field import BOTH, Field, mission_of, on_field
from tests.support.small_missions import at_heights, with_receivers
from uavmap.runner.before_flight import BeforeFlight, Preflight
from uavmap.runner.operator.ground_crew import Operator


def simulated(autopilot: str, second_m: float, sigma_m: float) -> Mission:
    """A mission of two whose second pad has this height, and receivers that err so much."""
    return at_heights(with_receivers(mission_of(autopilot, 2), sigma_m), (0.0, second_m))


def line_of(mission: Mission, given_m: float, folder: Path) -> str:
    """What preflight finds of the second home where its mission gives this height."""

    async def body(field: Field) -> None:
        setting = setting_of(at_heights(mission, (0.0, given_m)))
        dry = Preflight(lambda setting: [], dry_run=True).asked(setting)
        with pytest.raises(NotFlownError):
            await BeforeFlight(dry, setting, folder, field.links, Operator().ask).go()

    lines = "\n".join(on_field(body, mission).field.told).split("\n")
    (found,) = [line for line in lines if "home height: " in line]
    return found


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize(("given_m", "level"), [(8.0, "ok"), (6.5, "warn"), (0.0, "bad")])
def test_pad_heights_receivers_contradict_the_mission(
    autopilot: str, given_m: float, level: str, tmp_path: Path
) -> None:
    assert line_of(simulated(autopilot, 8.0, 0.0), given_m, tmp_path).startswith(f"{level:<5} 2 ")


@pytest.mark.parametrize("autopilot", BOTH)
def test_pad_heights_receivers_that_err_by_metres_are_believed_within_their_errors(
    autopilot: str, tmp_path: Path
) -> None:
    assert line_of(simulated(autopilot, 0.0, 3.0), 0.0, tmp_path).startswith("ok    2 ")


def test_pad_heights_contradicted_keep_the_team_on_the_ground(tmp_path: Path) -> None:
    mission = simulated("ardupilot", 8.0, 0.0)

    async def body(field: Field) -> None:
        setting = setting_of(at_heights(mission, (0.0, 0.0)))
        wanted = Preflight(lambda setting: [], yes=True).asked(setting)
        flight = BeforeFlight(wanted, setting, tmp_path, field.links, Operator().ask)
        with pytest.raises(PreflightError, match=r"home height: .*set vehicles.1..home_height_m"):
            await flight.go()

    on_field(body, mission)
