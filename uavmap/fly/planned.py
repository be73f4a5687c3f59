"""From what is asked for, by a command or in Python, to the plan of a flight."""

from __future__ import annotations

import time
from dataclasses import dataclass

from missions.errors import LinkError, MissionFileError
from missions.mission_file.schema import Mission
from uavmap.fly.cameras_of import cameras_of
from uavmap.mission_source import load_source
from uavmap.record.flight_plan import (
    PYMAVLINK,
    SIM_EPOCH_UTC_S,
    Driver,
    FleetNetwork,
    FlightPlan,
    check_member,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """A flight as its user asks for it; the fields are the options of `uavmap fly`.

    Attributes:
        mission: The path of a mission file, or the name of a shipped mission.
        sim: Whether the aircraft are simulated in this process.
        connect: The URLs of the vehicles; empty: those of the mission file.
        camera: The camera of each vehicle; empty: those of the mission file.
        vehicles: How many; None: as many as the mission file, or the URLs, say.
        seed: Of the simulation.
        speedup: Times real time.
        member: Which vehicle of the mission this one is, where each has a service of its own.
        network: How it reaches the others then.
        key: The file of the signing key, as an absolute path.
    """

    mission: str
    sim: bool = False
    connect: tuple[str, ...] = ()
    camera: tuple[str, ...] = ()
    vehicles: int | None = None
    strategy: str | None = None
    detector: str | None = None
    seed: int = 1
    speedup: float | None = None
    auto_swap: bool = False
    driver: Driver = PYMAVLINK
    onboard: bool = False
    member: int | None = None
    network: FleetNetwork | None = None
    key: str | None = None
    forward: tuple[str, ...] = ()


def planned(wanted: Wanted) -> tuple[FlightPlan, Mission]:
    """The plan, and the mission as its file says; nothing is written, and nobody spoken to.

    Raises `MissionFileError`, and `LinkError` where there is no vehicle, or one too many.
    """
    source = load_source(wanted.mission, wanted.detector)
    mission = source.parse()
    urls = wanted.connect
    if wanted.member == 0:
        urls = ()
    elif wanted.member is not None:
        check_member(mission, wanted.mission, wanted.member)
        url = mission.vehicles[wanted.member - 1].url
        urls = urls or (() if url is None else (url,))
    elif not wanted.sim and not urls:
        urls = tuple(v.url for v in mission.vehicles if v.url is not None)
        if 0 < len(urls) < len(mission.vehicles):
            raise MissionFileError(
                f"{wanted.mission}: vehicles: {len(urls)} of {len(mission.vehicles)} have a url; "
                "give one to each, or use --connect once a vehicle"
            )
    if not wanted.sim and len(urls) == 0 and wanted.member != 0:
        raise LinkError(
            f"{wanted.mission}: no vehicle to fly; give --connect URL (or vehicles.url in the "
            "mission file), or --sim for the simulator"
        )
    if wanted.sim and wanted.camera:
        raise LinkError("--camera goes with --connect: with --sim the cameras are simulated, too")
    plan = FlightPlan(
        mission_source=source.source,
        mission_text=source.text,
        strategy=wanted.strategy,
        vehicles=wanted.vehicles,
        seed=wanted.seed,
        urls=urls,
        speedup=wanted.speedup,
        auto_swap=wanted.auto_swap,
        driver=wanted.driver,
        cameras=wanted.camera,
        key_file=None if wanted.sim else wanted.key,
        onboard=wanted.onboard,
        member=wanted.member,
        network=wanted.network,
        forward=wanted.forward,
        epoch_utc_s=SIM_EPOCH_UTC_S if wanted.sim else time.time(),
    )
    plan.check_driver()
    if wanted.member != 0:  # says what is wrong before a folder is made
        cameras_of(plan.cameras, plan.mission(), plan.member)
    return plan, mission
