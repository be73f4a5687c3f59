"""One flight from its links to its results: vehicles, service, journal, telemetry log."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from missions.errors import OutputError, PreflightError
from missions.events import Event, Recalled, Resumed
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import Phase
from missions.orders import TakeOff
from missions.units import PadHeight
from uavmap.aircraft.guardian.last_watch import run_with_keeper
from uavmap.aircraft.process.messages import Begin, EarlierFlight
from uavmap.aircraft.process.port import Port
from uavmap.base import messages
from uavmap.base.clock import Clock, MissionClock, ScaledClock, VirtualClock, run
from uavmap.base.opencv_threads import ONE_THREAD_EACH
from uavmap.fleet.fleet_radio import fleet_communication, joined_fleet
from uavmap.fleet.member import Member
from uavmap.fleet.peer import LISTEN_S
from uavmap.fleet.radio import SealedRadio
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import TLOG, FlightPlan
from uavmap.journal.kept_frames import FrameKeeper
from uavmap.journal.mission_time import (
    Clocks,
    Marks,
    last_mark,
    mission_time,
    read_clocks,
    resume_time_s,
)
from uavmap.journal.telemetry_log import TlogWriter
from uavmap.output.facts.figures import Figures, FlightRecord, figures
from uavmap.output.results import flown_flight, write_results
from uavmap.runner.aircraft_process import AircraftProcess, Connection
from uavmap.runner.aircraft_side import in_this_process
from uavmap.runner.aircraft_takeover import Attachment
from uavmap.runner.before_flight import KEEP_FENCE
from uavmap.runner.flight_links import Link, mavlink_link
from uavmap.runner.operator.company import Company
from uavmap.runner.operator.flight_mosaic import FlightMosaic
from uavmap.runner.operator.ground_crew import (
    Crew,
    EnterKey,
    Operator,
    all_wait,
    doubts,
    log_last_positions,
)
from uavmap.runner.operator.interrupts import hold_signals, interrupts, leave_map, like_control_c
from uavmap.runner.operator.judged_picture import JudgedPicture
from uavmap.runner.operator.keyboard import Keys, keyboard
from uavmap.runner.preflight.vehicle_check import pad_heights
from uavmap.runner.service import GroundService, Reports, Service
from uavmap.runner.vehicles import judge_of, numbers_of

if TYPE_CHECKING:
    from uavmap.runner.simulation import Simulation, Truth

_LOG: Final = logging.getLogger("uavmap.flight")
KEEP_FRAMES: Final = "keep_frames"
"""Key of the journal's meta: whether pictures are kept (`uavmap.journal.kept_frames`)."""


class Flight:
    """A flight under way: opens links, runs the service, writes results.

    Its `journal` is open; `state` is the state before the next event. `again` repeats a recorded
    simulated flight first; `found` is the aircraft process of a mission process that died.
    """

    def __init__(
        self,
        plan: FlightPlan,
        folder: Path,
        journal: Journal,
        state: State,
        company: Company = Company(),  # noqa: B008 - frozen
        *,
        again: bool = False,
        found: Attachment | None = None,
    ) -> None:
        self._plan = plan
        self.setting = state.setting
        self.folder = folder
        self._journal = journal
        self._state = state
        # they end before a page does, which then shows their last output
        mine = (
            FlightMosaic(folder, self.setting, waits=plan.simulated),
            JudgedPicture(folder, self.setting, found=bool(state.belief.roi)),
        )
        self._company = replace(company, onlookers=(*mine, *company.onlookers))
        self._again = again
        self._found = found
        self._events_before = len(journal)
        self._resumed = self._events_before > 0 and not again
        self._service: Service | None = None
        self._record = FlightRecord(self.setting)
        self.clock = MissionClock(state.t_s)

    @property
    def state(self) -> State:
        """Present state of the mission."""
        return self._state if self._service is None else self._service.state

    def finish(self) -> dict[str, Any]:
        """Write the results of a flight that is over, and close its journal."""
        values = self._write_results(None)
        self._journal.close()
        return values

    def run(self) -> dict[str, Any]:
        """Fly and write the results."""
        with like_control_c():
            try:
                truth = self._flown()
            except BaseException as failure:
                with hold_signals():
                    with contextlib.suppress(Exception):  # whatever else is wrong, that comes first
                        if len(self._journal):
                            _LOG.info(f"to continue: uavmap resume {self.folder}")
                        if self._resumed and len(self._journal) == self._events_before:
                            log_last_positions(self._state)
                    if self._again or len(self._journal) > self._events_before:
                        leave_map(lambda: self._write_results(None), failure, self.folder)
                raise
        return self._write_results(truth)

    def _flown(self) -> Truth | None:
        """Fly; return the simulator's observations, None for real aircraft."""
        speedup, caller = self._plan.speedup, self._company.caller
        flight: Coroutine[Any, Any, Truth | None]
        clock: Clock
        if self._plan.simulated:
            flight, clock = self._fly_simulated(), VirtualClock(speedup)
        else:
            start_s = None if self._found is None else self._found.address.start_s
            flight, clock = self._fly_connected(), ScaledClock(speedup or 1.0, start_s)
        return run(flight if caller is None else caller.until_done(flight), clock)

    def _write_results(self, truth: Truth | None) -> dict[str, Any]:
        known = None
        if self._record.events == len(self._journal):  # else it was resumed, or continues after
            known = self._record.figures()
        return written_results(self._plan, self.setting, self.folder, self._journal, truth, known)

    # --- links ------------------------------------------------------------------------------
    async def _fly_simulated(self) -> Truth:
        from uavmap.runner.simulation import Simulation  # noqa: PLC0415 - real aircraft need no simulator

        world = Simulation(self.setting, self._plan.seed, start_s=self._state.t_s)
        # pictures are small: sharing each among threads costs more than it saves
        with ONE_THREAD_EACH, self._log() as log:
            links = [_simulated(world, index, log) for index in range(len(world.names()))]
            async with asyncio.TaskGroup() as tasks:
                turning = tasks.create_task(world.run())
                await self._serve(self._here(links))
                turning.cancel()
        return world.truth

    async def fly_member(self, world: Simulation, radio: SealedRadio) -> None:
        """Fly the one vehicle of this member in a world that others share."""
        with self._log() as log:
            links = [_simulated(world, (self.setting.member or 1) - 1, log)]
            await self._serve(self._here(links), radio)

    def _here(self, links: Sequence[Link]) -> Connection:
        return lambda port, begin: in_this_process(
            port, self._plan, self.setting, self.folder, links
        )

    def _log(self) -> TlogWriter:
        return TlogWriter(
            self.folder / TLOG,
            lambda: self._plan.epoch_utc_s + self.clock.now_s(),
            append=self._resumed,
            say=messages.bound("uavmap.flight").line,
        )

    async def _fly_connected(self) -> None:
        async with joined_fleet(self._plan, self.setting.mission, self._journal) as radio:
            connection = None
            if self.setting.member != 0:
                process = AircraftProcess(
                    self._plan, self.folder, self._found, append=self._resumed
                )
                connection = process.connected
            await self._serve(connection, radio)

    # --- service ----------------------------------------------------------------------------
    async def _serve(self, connection: Connection | None, radio: SealedRadio | None = None) -> None:
        """Fly with the aircraft that `connection` connects to a port, or without any."""
        real, company = not self._plan.simulated, self._company
        # keys need the main thread's signals
        enter = EnterKey() if real and company.caller is None else None
        crew = Crew(automatic=not real or self._plan.auto_swap, enter=enter)
        keeper = None
        if self._journal.meta.get(KEEP_FRAMES):
            say = messages.bound("uavmap.photos").line
            keeper = FrameKeeper(self.folder, say, aside=real)
        reports = Reports([onlooker.notice for onlooker in company.onlookers])
        keepers = [*([keeper] if keeper else ()), *company.onlookers]
        judge = judge_of(self.setting, keepers, recall=company.recall)
        port = Port(
            numbers_of(self.setting), self.clock.now_s, judge, reports.post, reports.join,
            crew.swap, Operator().ask, [onlooker.see_telemetry for onlooker in company.onlookers],
        )  # fmt: skip
        marks = Marks(self._journal, lambda: read_clocks(port.since_boot_s)) if real else None
        member = None
        if radio is not None:
            member = Member(self.setting, radio.seal, radio.radio, self.clock.now_s, reports.post)
            member.remember(self._journal.events())

        def observe(event: Event, state: State) -> None:
            self._record.note(event, state)
            if marks is not None:
                marks.note(self.clock.now_s())
            for onlooker in company.onlookers:
                onlooker.update(event, state, self._journal.expected)
            if member is not None:
                member.observe(event, state)
            if crew.keeps_waiting and all_wait(state, crew.waiting):
                _LOG.info(f"swap the batteries, then `uavmap resume {self.folder}` goes on")
                service.stop()

        parts = self._journal, port, self._state, observe, reports
        if connection is not None or member is None:
            service = Service(*parts)
        else:
            service = GroundService(*parts, member.command)
        self._service = service
        for onlooker in company.onlookers:
            onlooker.begin(self.setting, again=self._again)
        waits = not (crew.absent or self._plan.simulated or self._plan.auto_swap)
        begin = partial(self._begin, waits_on_ground=waits)
        try:
            with self._hands(service, enter, keeper):
                async with fleet_communication(member, may_leave=real):
                    if connection is None:
                        self._state = await self._fly(None, begin, service, member, crew)
                    else:
                        flying = self._fly(port, begin, service, member, crew)
                        self._state = await self._watched(connection(port, begin), port, flying)
        finally:
            port.close()
            if member is not None:  # messages of the fleet since
                service.flush_pending_events()
            for onlooker in company.onlookers:
                onlooker.end()

    @contextlib.contextmanager
    def _hands(
        self, service: Service, enter: EnterKey | None, keeper: FrameKeeper | None
    ) -> Iterator[None]:
        with contextlib.ExitStack() as hand:
            if keeper is not None:
                hand.enter_context(keeper)
            # a simulated flight just stops at an interrupt: no aircraft is in the air
            if not self._plan.simulated:
                hand.enter_context(interrupts(service, self._company.caller))
                if enter is not None:
                    hand.enter_context(keyboard(Keys(service), enter))
                for onlooker in self._company.onlookers:
                    hand.enter_context(onlooker.steering(service))
            yield

    async def _watched(
        self,
        connected: AbstractAsyncContextManager[None],
        port: Port,
        flying: Coroutine[Any, Any, State],
    ) -> State:
        """Fly with aircraft, whose guardians continue until all are down."""
        real = not self._plan.simulated
        async with connected:
            try:
                return await run_with_keeper(port, flying, leave=real)
            finally:
                # a simulated flight is flown again instead, event by event
                if real and self._service is not None:  # and the aircraft may drop kept events
                    self._service.flush_pending_events()

    def _begin(self, *, waits_on_ground: bool) -> Begin:
        company, before = self._company, {}
        begun = self._resumed or (self._service is not None and self._service.begun)
        for number in numbers_of(self.setting):
            left = self.state.vehicles[number]
            flew = not left.landed or isinstance(left.order, TakeOff)
            before[number] = EarlierFlight(
                begun and flew and left.phase is not Phase.YIELDED,
                begun and left.phase in (Phase.AIRBORNE, Phase.GUARDED),
            )
        # aircraft that are found again are not asked
        asked = (
            None if company.preflight is None or begun else company.preflight.options(self.setting)
        )
        kept = self._journal.meta.get(KEEP_FENCE) is True
        return Begin(self.clock.start_s, before, asked, kept, waits_on_ground)

    async def _fly(
        self,
        port: Port | None,
        begin: Callable[[], Begin],
        service: Service,
        member: Member | None,
        crew: Crew,
    ) -> State:
        pad = None
        if port is not None:
            ready = await port.begun(begin())
            pad = ready.pads.get(self.setting.member or 0)
            crew.doubt(doubts(self._journal.events(), ready.standing, self.setting.grid))
            if ready.start_s is not None:
                self.clock.start_s = ready.start_s
            elif self._resumed and not self._plan.simulated:
                await self._settle_time(read_clocks(port.since_boot_s))
        if member is not None:
            await self._agree(member, pad)
        if self._resumed:
            begin_s = round(self.clock.now_s(), 3)
            service.post(Resumed(begin_s))
            # before any vehicle reports, so that none is sent out first
            if self._company.recall:
                service.post(Recalled(begin_s))
        if port is not None:
            port.fly(self.clock.start_s)
        return await service.fly()

    # --- time -------------------------------------------------------------------------------
    async def _settle_time(self, clocks: Clocks) -> None:
        """Set the mission time of a resumed flight; the loop runs while the operator decides."""
        found = mission_time(
            self._state.t_s,
            last_mark(self._journal.meta),
            clocks,
            epoch_utc_s=self._plan.epoch_utc_s,
            speedup=self._plan.speedup or 1.0,
            drift_m_s=self.setting.mission.drift.speed_m_s,
        )
        self.clock.set(await asyncio.to_thread(resume_time_s, found, _LOG.info, self._company.ask))

    async def _agree(self, member: Member, pad: PadHeight | None) -> None:
        """Adopt the time of the other members of a fleet; time never runs backwards.

        Raises `PreflightError` if the heights of pads contradict the mission and our vehicle is on
        the ground.
        """
        # on a fast clock, the others' processes begin as late as on a slow one
        wait_s = LISTEN_S * (1.0 if self._plan.simulated else max(self._plan.speedup or 1.0, 1.0))
        by_s = await member.agree(wait_s, pad)
        heights = pad_heights(self.setting, member.pads) if pad is not None else {}
        if wrong := [replace(f, vehicle=n) for n, f in heights.items() if f.binding]:
            raise PreflightError("\n".join(["not flown:", *(f.line() for f in wrong)]))
        if self._resumed:  # the journal's events were before
            by_s = max(by_s, self._state.t_s - self.clock.now_s())
        self.clock.start_s += by_s
        member.clock_moved(by_s)
        if not member.peers:
            _LOG.info(f"no other member was in contact in {wait_s:.0f} s: it flies alone")


def _simulated(world: Simulation, index: int, log: TlogWriter) -> Link:
    session = world.open_session(index, log.record)
    return mavlink_link(world.names()[index], session, world.fetch)


def written_results(
    plan: FlightPlan,
    setting: Setting,
    folder: Path,
    journal: Journal,
    truth: Truth | None = None,
    known: tuple[State, Figures] | None = None,
) -> dict[str, Any]:
    """Write the results, from the journal unless its figures are `known`.

    The simulator's observations are kept for the next time that they are written.
    """
    if truth is not None:
        journal.put_meta("truth", truth.figures())
    known = known or figures(setting, journal.events())
    flown, _ = flown_flight(folder, plan, known, journal.meta.get("truth"))
    try:
        return write_results(flown, _LOG.info)
    except OSError as error:
        raise OutputError(
            f"{folder}: the results cannot be written ({error.strerror}); the journal is whole: "
            f"make room, and `uavmap resume {folder}` writes them"
        ) from None
