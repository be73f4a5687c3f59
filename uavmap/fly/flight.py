"""One flight from the command to the results: vehicles, service, journal, telemetry log.

A flight lives in a folder. Its journal holds all that is needed to go on: the mission as it is
flown, the options, and every event.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from missions.errors import JournalError, LinkError, OutputError, PreflightError
from missions.events import Event, Recalled, Resumed
from missions.mission_file.terrain_checks import refuse_unknown_ground
from missions.orders import TakeOff
from missions.state import Phase, Setting, State
from uavmap.cameras.mavlink import MavlinkSource
from uavmap.clock import Clock, ScaledClock, VirtualClock, run
from uavmap.comms.fleet_clock import AGREE_S
from uavmap.comms.fleet_radio import check_network, joined_fleet
from uavmap.comms.member import Member
from uavmap.comms.radio import Radio
from uavmap.comms.sealing import Seal
from uavmap.comms.talking import talking
from uavmap.fly.before_flight import KEEP_FENCE, BeforeFlight, Preflight, kept_fence
from uavmap.fly.caller import Caller
from uavmap.fly.cameras_of import cameras_of
from uavmap.fly.fleet import each_its_own, vehicles_of
from uavmap.fly.ground_crew import Crew
from uavmap.fly.ground_service import GroundService
from uavmap.fly.interrupts import interrupts, like_control_c
from uavmap.fly.keyboard import keyboard
from uavmap.fly.keys import Keys
from uavmap.fly.links import Link, LinkOptions, check_urls, opened_links, refuse_rivals
from uavmap.fly.map_so_far import leave_map, patiently
from uavmap.fly.onlooker import Both, Onlooker, folded
from uavmap.fly.progress import Progress
from uavmap.fly.service import Service
from uavmap.fly.vehicle import MavlinkVehicle
from uavmap.fly.watch_over import watched_over
from uavmap.kept_detector import drop_detector, keep_detector
from uavmap.link.urls import parse_url
from uavmap.record.flight_options import Driver, FleetNetwork
from uavmap.record.flight_plan import JOURNAL, REHOMED, TLOG, FlightPlan
from uavmap.record.frames import FrameKeeper, Keeper
from uavmap.record.journal import Journal
from uavmap.record.mission_time import Clocks, Marks, last_mark, read_clocks, taken_up_at
from uavmap.record.tlog import TlogWriter
from uavmap.results.documents import with_documents
from uavmap.results.score import true_roi
from uavmap.results.write_results import write_results

if TYPE_CHECKING:
    from uavmap.simulation import Simulation, Truth


KEEP_FRAMES: Final = "keep_frames"
"""In the journal's meta: whether the pictures of the flight are kept (`uavmap.record.frames`)."""

RIVAL_WALL_S: Final = 1.5
"""For so long another process that flies a vehicle is listened for: it speaks every second."""


def fly(
    plan: FlightPlan,
    folder: Path,
    progress: Progress,
    preflight: Preflight | None = None,
    *,
    keep_frames: bool = False,
    onlooker: Onlooker | None = None,
    caller: Caller | None = None,
) -> dict[str, Any]:
    """Fly a new mission into a folder; returns the summary.

    `preflight`: what is looked at, asked and set before real aircraft take off; a flight that is
    simulated in this process has none. `keep_frames`: whether the pictures stay in the folder.
    `onlooker` sees the pictures, and passes the operator's orders on to real aircraft.
    `caller`: who interrupts it, where this is not the program's main thread.

    Raises `MissionFileError`, `JournalError`, `LinkError`, `PreflightError`; `KeyboardInterrupt`
    when the operator leaves before the end.
    """
    setting = plan.setting(progress.say)
    refuse_unknown_ground(setting.mission, plan.mission_source)
    if plan.simulated and not setting.mission.sim.roi:
        progress.say(
            f"{plan.mission_source}: [[sim.roi]] is missing: there is nothing to be found on the "
            "simulated ground; give it a polygon"
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
        flight = Flight(plan, setting, folder, journal, State.initial(setting), progress)
        flight.preflight, flight.onlooker = preflight, onlooker
        flight.caller = caller
        if preflight is not None and preflight.keep_fence:
            journal.put_meta(KEEP_FENCE, True)
        if keep_frames:
            journal.put_meta(KEEP_FRAMES, True)
        try:
            return flight.run()
        except* (LinkError, PreflightError):
            if not len(journal):  # nobody answered: nothing has begun
                journal.discard()
                (folder / TLOG).unlink(missing_ok=True)
                drop_detector(folder)
                with contextlib.suppress(OSError):
                    folder.rmdir()
            raise


def resume(
    folder: Path,
    progress: Progress,
    *,
    urls: tuple[str, ...] = (),
    driver: Driver | None = None,
    cameras: tuple[str, ...] = (),
    key_file: str | None = None,
    forward: tuple[str, ...] | None = None,
    network: Callable[[FleetNetwork | None], FleetNetwork] | None = None,
    from_home: bool = False,
    recall: bool = False,
    ask: Callable[[str], bool] | None = None,
    onlooker: Onlooker | None = None,
    caller: Caller | None = None,
) -> dict[str, Any]:
    """Go on with the mission of a folder; returns the summary.

    A simulated world died with its process: it is made again by flying the recorded flight once
    more, and every event must come out as recorded, byte for byte. With `from_home` the aircraft
    stand at home with full batteries instead, as after a failsafe brought them back, and only
    the journal tells what is known; that is also how real aircraft are taken up. `driver` speaks
    with them instead of the one before; `network` makes the network of now of that before. With
    `recall` whoever is in the air comes home and lands, and nothing takes off. `ask` puts a
    question to the operator, where there is one. `onlooker` sees what was before, and all that
    `fly` shows to one.

    Raises as `fly` does, and `JournalError` for a `recall` of aircraft that are simulated here.
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
        if recall and plan.simulated:
            raise JournalError(
                f"{folder}: --recall is for aircraft at the end of a link; a simulated flight ends "
                f"with its process, and `uavmap resume {folder}` goes on with it"
            )
        plan.check_strategy()
        check_urls(plan.urls)
        _refuse_network(plan, folder)
        setting = plan.setting(progress.say)
        again = plan.simulated and not (from_home or plan.rehomed)
        state = folded(setting, journal.events(), None if again else onlooker)
        progress.say(
            f"{folder}: {len(journal)} events, mission time {state.t_s:.0f} s, "
            f"{len(state.belief.roi)} ROI cells"
        )
        if state.over and state.completed:
            progress.say("the mission is completed already; writing its results anew")
            return _results(plan, setting, folder, journal, None, progress.say)
        if again and state.over:
            raise JournalError(
                f"{folder}: the flight ended without completing its mission; "
                f"`uavmap resume {folder} --from-home` sends the aircraft out again"
            )
        if plan.simulated and not again and not plan.rehomed:
            plan = replace(plan, rehomed=True)
            journal.put_meta(REHOMED, True)
        if again:
            journal.start_verification()
            state = State.initial(setting)
        flight = Flight(plan, setting, folder, journal, state, progress, again=again)
        flight.ask = ask
        flight.recall = recall
        flight.onlooker = onlooker
        flight.caller = caller
        return flight.run()


def _refuse_network(plan: FlightPlan, folder: Path) -> None:
    """Raise `LinkError` for a network that cannot be opened, or that no member is to have."""
    if plan.member is None and plan.network is not None:
        raise LinkError(
            f"{folder}: --listen, --peer, --router and --fleet-key go with a flight that "
            "`uavmap onboard` began; this one flies all its vehicles itself"
        )
    check_network(plan.network)


def plan_of(journal: Journal) -> FlightPlan:
    """The plan of a flight that can be gone on with. Raises `JournalError` for a replay."""
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


class Flight:
    """A flight under way: opens links, runs the service, writes results."""

    def __init__(
        self,
        plan: FlightPlan,
        setting: Setting,
        folder: Path,
        journal: Journal,
        state: State,
        progress: Progress,
        *,
        again: bool = False,
    ) -> None:
        self._plan = plan
        self._setting = setting
        self._folder = folder
        self._journal = journal
        self._state = state
        self._left = state.vehicles
        """As the journal tells them, when it is gone on with."""
        self._progress = progress
        self._again = again
        self._events_before = len(journal)
        """How many events there were when it began."""
        self._resumed = self._events_before > 0 and not again
        self._start_s = state.t_s
        self._marks = None if plan.simulated else Marks(journal, self._clocks)
        self._vehicle_clock: Callable[[], float | None] = lambda: None
        self.ask: Callable[[str], bool] | None = None
        """Puts a question to the operator, where there is one."""
        self.preflight: Preflight | None = None
        self.onlooker: Onlooker | None = None
        self.caller: Caller | None = None
        """Who interrupts a flight that runs in a thread of its own."""
        self.recall = False
        """Whether whoever is in the air is only brought home."""
        self._truth: Truth | None = None
        self._service: Service | None = None
        self.radio: Radio | None = None
        """How this member of a fleet speaks with the others."""
        self.seal: Seal | None = None
        self.member: Member | None = None

    @property
    def folder(self) -> Path:
        """Where its journal and its results are."""
        return self._folder

    @property
    def setting(self) -> Setting:
        """What it was given."""
        return self._setting

    @property
    def state(self) -> State:
        """The mission as it is known now."""
        return self._state if self._service is None else self._service.state

    def finish(self) -> dict[str, Any]:
        """Write the results of a flight that is over, and close its journal."""
        values = self._write_results(self._truth)
        self._journal.close()
        return values

    def close(self) -> None:
        """Close its journal: nothing that happens after it is kept."""
        self._journal.close()

    def run(self) -> dict[str, Any]:
        """Fly and write the results."""
        with like_control_c():
            self._run()
        return self._write_results(self._truth)

    def _run(self) -> None:
        clock: Clock
        try:
            if self._plan.simulated:
                clock = VirtualClock(self._plan.speedup)
                run(self._called(self._fly_simulated()), clock)
            else:
                clock = ScaledClock(self._plan.speedup or 1.0)
                run(self._called(self._fly_connected()), clock)
        except BaseException as failure:
            with patiently(self._progress.say):
                with contextlib.suppress(Exception):  # whatever else is wrong, that comes first
                    if len(self._journal):
                        self._progress.say(f"to go on: uavmap resume {self._folder}")
                if self._again or len(self._journal) > self._events_before:
                    leave_map(
                        lambda: self._write_results(None), failure, self._folder, self._progress.say
                    )
            raise

    def _write_results(self, truth: Truth | None) -> dict[str, Any]:
        return _results(
            self._plan, self._setting, self._folder, self._journal, truth, self._progress.say
        )

    async def _called(self, flight: Awaitable[None]) -> None:
        await (flight if self.caller is None else self.caller.until_done(flight))

    @property
    def now_s(self) -> float:
        """Mission time."""
        return self._now_s()

    def _now_s(self) -> float:
        """Mission time."""
        return self._start_s + asyncio.get_running_loop().time()

    def set_clock(self, now_s: float) -> None:
        """Have it be this mission time now."""
        self._start_s = now_s - asyncio.get_running_loop().time()

    def _clocks(self) -> Clocks:
        return read_clocks(self._vehicle_clock())

    async def _settle_time(self) -> None:
        """Mission time of a flight that goes on: by what the clocks say, the vehicle's among them.

        The loop goes on while the operator thinks.
        """
        start_s = await asyncio.to_thread(
            taken_up_at,
            last_mark(self._journal.meta),
            self._state.t_s,
            self._clocks(),
            epoch_utc_s=self._plan.epoch_utc_s,
            speedup=self._plan.speedup or 1.0,
            drift_m_s=self._setting.mission.drift.speed_m_s,
            say=self._progress.say,
            ask=self.ask,
        )
        self.set_clock(start_s)

    async def _agree(self, member: Member) -> None:
        """Count the seconds that the others of a fleet count. Time never runs backwards."""
        # on a clock that runs fast, the others' processes begin as late as on a slow one
        wait_s = AGREE_S * (1.0 if self._plan.simulated else max(self._plan.speedup or 1.0, 1.0))
        by_s = await member.agree(wait_s)
        if self._resumed:  # what the journal holds was before
            by_s = max(by_s, self._state.t_s - self._now_s())
        self._start_s += by_s
        member.clock_moved(by_s)
        if not member.peers:
            self._progress.say(f"nobody of the fleet was heard in {wait_s:.0f} s: it flies alone")

    def _log(self) -> TlogWriter:
        append = self._resumed and (self._folder / TLOG).exists()
        rate = 1.0 if self._plan.simulated else 1.0 / (self._plan.speedup or 1.0)
        return TlogWriter(
            self._folder / TLOG,
            lambda: self._plan.epoch_utc_s + self._now_s() * rate,
            append=append,
            say=self._progress.say,
        )

    # --- simulated -------------------------------------------------------------------------
    async def _fly_simulated(self) -> None:
        from uavmap.simulation import Simulation  # noqa: PLC0415 - real aircraft need no simulator

        simulation = Simulation(self._setting, self._plan.seed, start_s=self._start_s)
        self._truth = simulation.truth
        with self._log() as log:
            links = [
                Link(name, session, MavlinkSource(session, simulation.fetch))
                for index, name in enumerate(simulation.names())
                for session in [simulation.open_session(index, log.record)]
            ]
            async with asyncio.TaskGroup() as tasks:
                world = tasks.create_task(simulation.run())
                await self._serve(links)
                world.cancel()

    async def fly_member(self, world: Simulation) -> None:
        """Fly the one vehicle of this member in a world that others fly in, too."""
        index = (self._setting.member or 1) - 1
        with self._log() as log:
            session = world.open_session(index, log.record)
            await self._serve(
                [Link(world.names()[index], session, MavlinkSource(session, world.fetch))]
            )

    # --- connected -------------------------------------------------------------------------
    async def _fly_connected(self) -> None:
        plan, setting, say = self._plan, self._setting, self._progress.say
        with self._log() as log:
            camera = setting.mission.camera
            listens = setting.member == 0
            cameras = () if listens else cameras_of(plan.cameras, setting.mission, setting.member)
            async with (
                opened_links(
                    plan.urls, LinkOptions.of(plan), cameras, camera, log.record, say
                ) as links,
                joined_fleet(plan, setting.mission, self._journal, say) as (self.radio, self.seal),
            ):
                await self._serve(links)

    # --- both ------------------------------------------------------------------------------
    async def _serve(self, links: Sequence[Link]) -> None:
        """Fly the mission, and look after the aircraft however that ends."""
        automatic = self._plan.simulated or self._plan.auto_swap
        say = self._progress.say
        crew = Crew(say, automatic=automatic)
        may_stop = self._plan.simulated
        keeper = None
        if self._journal.meta.get(KEEP_FRAMES):
            keeper = FrameKeeper(self._folder, say, aside=not may_stop)
        seen_by: Keeper | None = keeper or self.onlooker
        if keeper is not None and self.onlooker is not None:
            seen_by = Both(keeper, self.onlooker)
        vehicles = vehicles_of(
            self._plan, self._setting, links, crew, self._now_s, say, seen_by, recall=self.recall
        )
        before = None if self._plan.simulated or not links else self._before(links)

        def observe(event: Event, state: State) -> None:
            if self._marks is not None:
                self._marks.note(self._now_s())
            self._progress.update(event, state, again=self._journal.expected)
            if self.member is not None:
                self.member.observe(event, state)
            if crew.absent and _all_wait(state, crew.waiting):
                say(f"swap the batteries, then `uavmap resume {self._folder}` goes on")
                service.stop()

        kind = Service if vehicles else GroundService
        service = kind(self._setting, self._journal, vehicles, self._state, observe, say)
        self._service = service
        if self.radio is not None and self.seal is not None:
            self.member = Member(
                self._setting, self.seal, self.radio, self._now_s, service.post, say
            )
            self.member.remember(self._journal.events())
            if isinstance(service, GroundService):
                service.tell_all = self.member.order
        self._progress.begin(self._setting, again=self._again)
        guardians = [vehicle.guardian for vehicle in vehicles.values()]
        try:
            with contextlib.ExitStack() as hand:
                if keeper is not None:
                    hand.enter_context(keeper)
                # a simulated flight just stops when it is interrupted: nobody is in the air
                if not may_stop:
                    hand.enter_context(interrupts(service, say, self.caller))
                    if self.caller is None:  # keys need the main thread's signals, too
                        hand.enter_context(keyboard(Keys(service, say), crew, say))
                    if self.onlooker is not None:
                        hand.enter_context(self.onlooker.hand(service, say))
                async with talking(self.member, None if may_stop else say):
                    self._state = await watched_over(
                        guardians,
                        self._fly(vehicles, links, service, before),
                        leave=not may_stop,
                    )
        finally:
            if (
                not may_stop or self.member is not None
            ):  # a simulated flight is flown again instead, event by event
                service.keep_last_words()
            for vehicle in vehicles.values():
                with contextlib.suppress(LinkError):
                    await vehicle.leave_as_found()
            if before is not None:
                await before.restore()
            self._progress.end()

    def _before(self, links: Sequence[Link]) -> BeforeFlight:
        """What comes before the take-off of real aircraft."""
        keep_fence = kept_fence(self._journal.meta)
        return BeforeFlight(
            self.preflight, self._setting, self._folder, links, self._progress.say,
            keep_fence=keep_fence,
        )  # fmt: skip

    async def _fly(
        self,
        vehicles: dict[int, MavlinkVehicle],
        links: Sequence[Link],
        service: Service,
        before_flight: BeforeFlight | None,
    ) -> State:
        for number, vehicle in vehicles.items():
            left = self._left[number]
            flew = not left.landed or isinstance(left.order, TakeOff)
            if self._resumed and flew and left.phase is not Phase.YIELDED:
                vehicle.was_flying()
        for number, vehicle in vehicles.items():
            await vehicle.connect()
            before = self._left[number]
            if self._resumed and before.phase in (Phase.AIRBORNE, Phase.GUARDED):
                vehicle.was_returning()
        each_its_own(vehicles)
        if not self._plan.simulated:
            await refuse_rivals(links, RIVAL_WALL_S * (self._plan.speedup or 1.0))
        if before_flight is not None:
            await before_flight.go()
        if vehicles:
            first = vehicles[min(vehicles)]
            self._vehicle_clock = lambda: first.view.since_boot_s
        if self._resumed and not self._plan.simulated and vehicles:
            await self._settle_time()
        if self.member is not None:
            await self._agree(self.member)
        if self._resumed:
            begin_s = round(self._now_s(), 3)
            service.post(Resumed(begin_s))
            if self.recall:  # taken in before any vehicle reports, so nobody is sent out before
                service.post(Recalled(begin_s))
        return await service.fly()


def _all_wait(state: State, waiting: set[int]) -> bool:
    """Whether everybody who is not done waits for a battery that nobody here will announce."""
    return bool(waiting) and all(
        number in waiting or v.ended for number, v in state.vehicles.items()
    )


def _results(
    plan: FlightPlan,
    setting: Setting,
    folder: Path,
    journal: Journal,
    truth: Truth | None,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Write the results; what the simulator watched is kept for when they are written anew."""
    if truth is not None:
        journal.put_meta("truth", truth.figures())
    roi = None
    if plan.simulated and setting.mission.sim.roi:
        roi = true_roi(setting.mission, setting.grid)
    seed = plan.seed if plan.simulated else None
    events = list(journal.events())
    calendar, also = with_documents(folder, plan, setting, events, say)
    try:
        return write_results(
            folder, setting, events, seed, journal.meta.get("truth"), roi, calendar, also
        )
    except OSError as error:
        raise OutputError(
            f"{folder}: the results cannot be written ({error.strerror}); the journal is whole: "
            f"make room, and `uavmap resume {folder}` writes them"
        ) from None
