"""The aircraft of a flight: a link to each, and the vehicle of the mission at its other end."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final

from missions.errors import LinkError, MissionFileError
from missions.flight.strategies import chosen
from missions.flight.strategy.leapfrog import MAPPER, TRACKER
from missions.flight.strategy.leapfrog import Leapfrog as LeapfrogStrategy
from missions.mission.layout import Layout
from missions.planning.leapfrog_geometry import Role
from uavmap.aircraft.cameras.pose import Poses
from uavmap.aircraft.cameras.source import LocalSource
from uavmap.aircraft.imaging.classifier import Blind, Classifier, PictureJudge, detector_of
from uavmap.aircraft.imaging.imaging import CameraDriver
from uavmap.aircraft.leapfrog_sight import Leapfrog
from uavmap.aircraft.process.host import Host
from uavmap.aircraft.reporter import BATTERY_STALE_S
from uavmap.aircraft.vehicle import LINK_LOST_S, SILENCE_ON_GROUND_S, MavlinkVehicle
from uavmap.base.clock import WINDOW_WALL_S, ClockRate
from uavmap.journal.flight_plan import FlightPlan
from uavmap.journal.kept_frames import Keeper
from uavmap.mavlink.identity import same_aircraft
from uavmap.runner.flight_links import Link, log_with, mount_of
from vision.detectors import Detector

_LOG: Final = logging.getLogger("uavmap.flight")
LINK_LOST_WALL_S: Final = 2.0
BATTERY_STALE_WALL_S: Final = 5.0
SLACK_WALL_S: Final = 2.0
"""Additional time on a fast clock, real seconds: a busy machine must not look like a fault."""
STREAMED_SPEEDUP: Final = 3.0
"""Maximum speed-up with streamed setpoints, whose timeout is a second of the vehicle's time.

On a faster clock vehicles fly to places ahead, and stop there.
"""


def numbers_of(setting: Layout) -> Sequence[int]:
    """Return the numbers of the vehicles that this service flies."""
    if setting.member is not None:
        return (setting.member,) if setting.member else ()
    return range(1, len(setting.mission.vehicles) + 1)


def judge_of(
    setting: Layout, keepers: Sequence[Keeper] = (), *, recall: bool = False
) -> PictureJudge:
    """Return the judge of the pictures of a mission's vehicles.

    A `recall` needs no detector; else it raises `MissionFileError` for a missing model.
    """
    detector, mission = _blind_without(setting) if recall else None, setting.mission
    classifiers = {
        number: Classifier.for_mission(
            mission, setting.grid, mission.altitude_m(number - 1), detector
        )
        for number in numbers_of(setting)
    }
    return PictureJudge(classifiers, keepers)


def vehicles_of(
    plan: FlightPlan,
    setting: Layout,
    links: Sequence[Link],
    host: Host,
    mission_time_s: Callable[[], float],
    *,
    waits_on_ground: bool = False,
) -> dict[int, MavlinkVehicle]:
    """Return the vehicle at the end of each link, by its number in the mission, from 1.

    With `waits_on_ground` a crew is beside silent vehicles on the ground, without a time limit.
    """
    speedup = max(plan.speedup or 1.0, 1.0)
    # on a fast clock, a busy machine must not look like a lost link
    link_lost_s, stale_s, slack_s = LINK_LOST_S, BATTERY_STALE_S, 0.0
    if not plan.simulated:
        link_lost_s = max(link_lost_s, LINK_LOST_WALL_S * (plan.speedup or 1.0))
        stale_s = max(stale_s, BATTERY_STALE_WALL_S * speedup)
        slack_s = SLACK_WALL_S * (speedup - 1.0)
    vehicles = {}
    for number, link in zip(numbers_of(setting), links, strict=True):
        view = link.session.view
        view.gate.area = setting.mission.home
        view.gate.say = partial(log_with, host.line, f"vehicle {number}")
        poses = Poses(link.session, mount_of(setting.mission.camera), setting.grid)
        if isinstance(link.camera, LocalSource):  # its pictures have no pose
            poses.need_telemetry()
        vehicles[number] = MavlinkVehicle(
            number,
            link.name,
            link.session,
            CameraDriver(number, link.camera, poses, setting.mission, host.judge, mission_time_s),
            setting,
            mission_time_s,
            host.swap,
            link_lost_s,
            battery_stale_s=stale_s,
            ground_patience_s=None if waits_on_ground else SILENCE_ON_GROUND_S,
            slack_s=slack_s,
            by_places=not plan.simulated and speedup > STREAMED_SPEEDUP,
            tell=host.line,
            clock_rate=None
            if plan.simulated
            else ClockRate(WINDOW_WALL_S * (plan.speedup or 1.0), plan.speedup or 1.0),
        )
    if isinstance(chosen(setting.mission), LeapfrogStrategy):
        both = Leapfrog(setting.mission.navigation, host.line)
        vehicles[MAPPER].leapfrog(both, Role.MAPPER)
        vehicles[TRACKER].leapfrog(both, Role.TRACKER)
    return vehicles


def _blind_without(setting: Layout) -> Detector | None:
    """Return a substitute that judges pictures during the return if the mission's detector is
    missing."""
    try:
        detector_of(setting.mission)
    except MissionFileError as error:
        _LOG.info(f"{error}; the aircraft are brought home without it")
        return Blind()
    return None


def require_distinct_aircraft(vehicles: Mapping[int, MavlinkVehicle]) -> None:
    """Raise `LinkError` if two links lead to one aircraft, as through a router."""
    for (_, one), (_, other) in itertools.combinations(vehicles.items(), 2):
        if same_aircraft(one.view, other.view):
            raise LinkError(
                f"{one.name} and {other.name} lead to the same aircraft (system "
                f"{one.view.system_id}); give every vehicle a link and a system id of its own"
            )
