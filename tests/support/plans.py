"""Plans of flights from the text of a mission, and the texts of missions."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from missions.mission.checks import FLOWN
from missions.mission.schema import Mission
from uavmap.journal.flight_plan import SIM_EPOCH_UTC_S, FlightOptions, FlightPlan
from uavmap.load.mission_source import mission_of_text


class MissionText(NamedTuple):
    source: str
    text: str


def named_text(name: str) -> MissionText:
    """Return the text of a shipped mission, or of a mission file."""
    shipped = resources.files("missions") / "shipped" / f"{name}.toml"
    file = shipped if shipped.is_file() else Path(name)
    return MissionText(name, file.read_text("utf-8"))


def plan_of(
    mission_source: str,
    mission: str | Mission,
    strategy: str | None = None,
    vehicles: int | None = None,
    seed: int = 1,
    urls: tuple[str, ...] = (),
    speedup: float | None = None,
    epoch_utc_s: float = SIM_EPOCH_UTC_S,
    **options: Any,
) -> FlightPlan:
    """Return a plan of a mission, or of its text; simulated if there is no URL."""
    if isinstance(mission, str):
        mission = mission_of_text(mission, mission_source)
    asked = FlightOptions(
        mission_source=mission_source,
        simulated=not urls,
        strategy=strategy,
        vehicles=vehicles,
        seed=seed,
        urls=urls,
        speedup=speedup,
        all_strategies=strategy is not None and strategy not in FLOWN,
        **options,
    )
    return FlightPlan.make(asked, mission, epoch_utc_s)
