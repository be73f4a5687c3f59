"""From the options of a flight to its plan."""

from __future__ import annotations

import time
from dataclasses import replace

from missions.errors import LinkError, MissionFileError
from missions.mission.schema import Mission
from uavmap.journal.flight_options import FlightOptions
from uavmap.journal.flight_plan import SIM_EPOCH_UTC_S, FlightPlan, check_member
from uavmap.load.mission_source import load
from uavmap.runner.flight_cameras import cameras_of


def planned(options: FlightOptions) -> FlightPlan:
    """Load the mission and make the plan; nothing is written, and no vehicle is connected.

    Raises `MissionFileError`, and `LinkError` where there is no vehicle, or one too many.
    """
    mission = load(options.mission_source, options.detector)
    options = replace(options, urls=_urls(options, mission))
    epoch_utc_s = SIM_EPOCH_UTC_S if options.simulated else time.time()
    plan = FlightPlan.make(options, mission, epoch_utc_s)
    if plan.member != 0:  # a faulty camera is reported before a folder is made
        cameras_of(plan.cameras, plan.mission, plan.member)
    return plan


def _urls(options: FlightOptions, mission: Mission) -> tuple[str, ...]:
    """The URLs of the vehicles that this service flies: those given, else the mission's."""
    if options.simulated or options.member == 0:
        return ()
    urls, source = options.urls, options.mission_source
    if options.member is not None:
        check_member(mission, source, options.member)
        url = mission.vehicles[options.member - 1].url
        urls = urls or (() if url is None else (url,))
    elif not urls:
        urls = tuple(v.url for v in mission.vehicles if v.url is not None)
        if 0 < len(urls) < len(mission.vehicles):
            raise MissionFileError(
                f"{source}: vehicles: {len(urls)} of {len(mission.vehicles)} have a url; "
                "give one to each, or use --connect once a vehicle"
            )
    if not urls:
        raise LinkError(
            f"{source}: no vehicle to fly; give --connect URL (or vehicles.url in the "
            "mission file), or --sim for the simulator"
        )
    return urls
