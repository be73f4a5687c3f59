"""One flight from the command to the results, in a folder whose journal allows a resume."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from missions.errors import (
    JournalError,
    LinkError,
    MissionFileError,
    NotFlownError,
    OutputError,
    PreflightError,
)
from missions.flight.state import Setting, State
from missions.mission.height_and_speed import refuse_unknown_ground
from missions.mission.schema import Mission
from missions.mission.sections import LATER
from uavmap.base.extras import install_command
from uavmap.fleet.fleet_radio import check_network
from uavmap.journal.event_log import PLAIN, Journal, planner
from uavmap.journal.flight_plan import (
    JOURNAL,
    REHOMED,
    SIM_EPOCH_UTC_S,
    TLOG,
    Driver,
    FleetNetwork,
    FlightOptions,
    FlightPlan,
    check_member,
)
from uavmap.load.detector_source import drop_detector, keep_detector, region_in_words
from uavmap.load.mission_source import load
from uavmap.mavlink.links.urls import parse_url
from uavmap.runner.aircraft_takeover import take_over_aircraft
from uavmap.runner.before_flight import KEEP_FENCE, is_left_set, put_back
from uavmap.runner.flight_links import cameras_of, check_urls
from uavmap.runner.one_flight import KEEP_FRAMES, Flight, written_results
from uavmap.runner.operator.company import Company, Onlooker, folded

_LOG: Final = logging.getLogger("uavmap.flight")


def planned(options: FlightOptions) -> FlightPlan:
    """Load the mission and make the plan; write nothing, connect nothing.

    Raises `MissionFileError`, and `LinkError` without a vehicle, or with one too many.
    """
    mission = load(options.mission_source, options.detector)
    options = replace(options, urls=_urls(options, mission))
    epoch_utc_s = SIM_EPOCH_UTC_S if options.simulated else time.time()
    plan = FlightPlan.make(options, mission, epoch_utc_s)
    if plan.mission.search.find != mission.search.find:
        _LOG.info(
            f"--strategy {options.strategy}: search.find and search.altitude_m of the mission are "
            "for swath, and are set aside"
        )
    if mission.detector.name == LATER:
        _LOG.info(f"no detector is chosen yet: region = {region_in_words(mission.detector)}")
    if plan.member != 0:  # a faulty camera is reported before a folder is made
        cameras_of(plan.cameras, plan.mission, plan.member)
    return plan


def _urls(options: FlightOptions, mission: Mission) -> tuple[str, ...]:
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
    for url in urls:
        parse_url(url)  # a faulty one is reported before a folder is made
    return urls


def fly(
    plan: FlightPlan,
    folder: Path,
    company: Company = Company(),  # noqa: B008 - frozen
    *,
    keep_frames: bool = False,
) -> dict[str, Any]:
    """Fly a new mission into a folder; return the summary. `keep_frames` keeps the pictures there.

    Raises `MissionFileError`, `JournalError`, `LinkError`, `PreflightError`; `KeyboardInterrupt`
    when the operator leaves before the end.
    """
    setting = plan.setting(_LOG.info)
    refuse_unknown_ground(setting.mission, plan.mission_source)
    if plan.simulated:
        from uavmap.runner.simulation import (  # noqa: PLC0415 - real aircraft need no simulator
            refuse_unreadable_world,
        )

        refuse_unreadable_world(setting.mission)
    if plan.simulated and not (setting.mission.sim.roi or setting.mission.sim.world):
        _LOG.info(
            f"{plan.mission_source}: [[sim.roi]] is missing: there is nothing to be found on the "
            "simulated ground; give it a polygon, or name a picture of your ground: sim.world"
        )
    check_urls(plan.urls)
    check_network(plan.network)
    for url in plan.forward:
        parse_url(url)
    with Journal.create(folder / JOURNAL, {"plan": plan.as_json()}) as journal:
        try:
            keep_detector(setting.mission.detector, folder)
        except OutputError:
            journal.discard()
            raise
        flight = Flight(plan, folder, journal, setting.initial_state(), company)
        if company.preflight is not None and company.preflight.keep_fence:
            journal.put_meta(KEEP_FENCE, True)
        if keep_frames:
            journal.put_meta(KEEP_FRAMES, True)
        try:
            return flight.run()
        except* (LinkError, PreflightError):
            if not len(journal) and not is_left_set(folder):  # nothing has begun
                _discard(journal)
            raise


def _discard(journal: Journal) -> None:
    """Remove the files of a flight that has not begun, and its folder if nothing else is in it."""
    folder = journal.path.parent
    journal.discard()
    (folder / TLOG).unlink(missing_ok=True)
    drop_detector(folder)
    with contextlib.suppress(OSError):
        folder.rmdir()


def resume(
    folder: Path,
    company: Company = Company(),  # noqa: B008 - frozen
    *,
    urls: tuple[str, ...] = (),
    driver: Driver | None = None,
    cameras: tuple[str, ...] = (),
    key_file: str | None = None,
    forward: tuple[str, ...] | None = None,
    network: Callable[[FleetNetwork | None], FleetNetwork] | None = None,
    from_home: bool = False,
) -> dict[str, Any]:
    """Resume the mission of a folder; return the summary.

    A simulated world died with its process. The recorded flight is flown once more to make it
    again, and every event must come out as recorded, byte for byte. With `from_home` the aircraft
    are at home with full batteries instead, as after a failsafe; so are real ones. `driver`
    replaces the one before; `network` makes the present network of the one before. With a `recall`
    vehicles in the air return and land, and none takes off. If nothing has begun, or all is done,
    nothing is flown: the autopilots' settings are restored.

    Raises as `fly` does, `NotFlownError` if nothing had begun, and `JournalError` for a recall of
    aircraft that are simulated here.
    """
    with Journal.open(folder / JOURNAL) as journal:
        plan = plan_of(journal)
        plan = replace(
            plan,
            simulated=plan.simulated and not urls,
            all_strategies=plan.all_strategies and not urls,
            urls=urls or plan.urls,
            driver=driver or plan.driver,
            cameras=cameras or plan.cameras,
            key_file=key_file or plan.key_file,
            forward=plan.forward if forward is None else forward,
            network=plan.network if network is None else network(plan.network),
        )
        if company.recall and plan.simulated:
            raise JournalError(
                f"{folder}: --recall is for aircraft at the end of a link; a simulated flight ends "
                f"with its process, and `uavmap resume {folder}` goes on with it"
            )
        plan.check_simulated_only()
        check_urls(plan.urls)
        _refuse_network(plan, folder)
        setting = plan.setting(_LOG.info)
        found = None if plan.simulated or plan.member == 0 else take_over_aircraft(folder, journal)
        if found is not None and (urls or driver or cameras or key_file or forward is not None):
            _LOG.info("it goes on with the links that it has; options for links are left out")
        left_set = not plan.simulated and found is None and is_left_set(folder)
        if left_set and not len(journal):
            _put_back_alone(plan, setting, journal)
        again = plan.simulated and not (from_home or plan.rehomed)
        state = _state_of(journal, setting, () if again else company.onlookers)
        if state.is_over and state.completed:
            _LOG.info("the mission is completed already; writing its results anew")
            summary = written_results(plan, setting, folder, journal)
            if left_set:
                put_back(plan, setting, folder)
            return summary
        if again:
            _refuse_repetition(journal, state)
            journal.start_verification()
            state = setting.initial_state()
        elif plan.simulated and not plan.rehomed:
            plan = replace(plan, rehomed=True)
            journal.put_meta(REHOMED, True)
        return Flight(plan, folder, journal, state, company, again=again, found=found).run()


def _put_back_alone(plan: FlightPlan, setting: Setting, journal: Journal) -> None:
    done = put_back(plan, setting, journal.path.parent)
    if done:
        _discard(journal)
    text = "nothing was flown here; what was set on the autopilots is "
    raise NotFlownError(text + ("put back" if done else "not put back"), could_fly=done)


def _state_of(journal: Journal, setting: Setting, onlookers: Sequence[Onlooker]) -> State:
    """Return the state of the journal and log it for the operator; onlookers see its events."""
    if journal.torn:
        _LOG.info(f"{journal.path}: its last line was cut short, and is left out")
    state = folded(setting, journal.events(), onlookers)
    _LOG.info(
        f"{journal.path.parent}: {len(journal)} events, mission time {state.t_s:.0f} s, "
        f"{len(state.belief.roi)} ROI cells"
    )
    return state


def _refuse_network(plan: FlightPlan, folder: Path) -> None:
    if plan.member is None and plan.network is not None:
        raise LinkError(
            f"{folder}: --listen, --peer, --router and --fleet-key go with a flight that "
            "`uavmap onboard` began; this one flies all its vehicles itself"
        )
    check_network(plan.network)


def _refuse_repetition(journal: Journal, state: State) -> None:
    """Raise `JournalError` if a simulated flight would come out differently, or is over."""
    here, folder = planner(), journal.path.parent
    if not state.setting.strategy.stops and journal.planner != here:
        remedy = "remove numba (`pip uninstall numba`)"
        if here == PLAIN:
            remedy = f"install numba (`{install_command('fast')}`)"
        raise JournalError(
            f"{folder}: the flight was planned by the {journal.planner} planner, and here it is "
            f"{here}, which plans other paths; {remedy}, or `uavmap resume {folder} --from-home` "
            "goes on without repeating the flight"
        )
    if state.is_over:
        raise JournalError(
            f"{folder}: the flight ended without completing its mission; "
            f"`uavmap resume {folder} --from-home` sends the aircraft out again"
        )


def plan_of(journal: Journal) -> FlightPlan:
    """Return the plan of a flight that can be continued. Raises `JournalError` for a replay."""
    if "replay" in journal.meta:
        images, folder = journal.meta["replay"], journal.path.parent
        raise JournalError(
            f"{folder} is a replay of the photographs in {images}: nothing was flown, there is "
            f"nothing to go on with; `uavmap replay {images}` makes the map anew"
        )
    plan = FlightPlan.read(journal)
    folder = journal.path.parent
    if plan.member == 0 and plan.network is None:
        raise JournalError(
            f"{folder} holds the map of several journals; go on with the flight of each vehicle"
        )
    if plan.member is not None and plan.comms is not None:
        raise JournalError(
            f"{folder} is of a simulated fleet, which ends with its process; fly it anew"
        )
    return plan
