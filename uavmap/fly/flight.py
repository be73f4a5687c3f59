"""One flight from the command to the results: vehicles, service, journal, telemetry log.

A flight lives in a folder. Its journal holds all that is needed to go on: the mission file's
text, what the command line changed in it, the seed, the URLs, and every event.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import signal
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from missions.errors import JournalError, LinkError, OutputError
from missions.events import Event, Resumed
from missions.orders import TakeOff
from missions.state import Phase, Setting, State
from missions.step import fold
from uavmap.clock import Clock, ScaledClock, VirtualClock, run
from uavmap.fly.classifier import Classifier
from uavmap.fly.ground_crew import Crew
from uavmap.fly.http_pictures import PictureFetcher
from uavmap.fly.imaging import CameraDriver, Fetch
from uavmap.fly.progress import Progress
from uavmap.fly.reporter import BATTERY_STALE_S
from uavmap.fly.service import Service
from uavmap.fly.vehicle import LINK_LOST_S, ON_GROUND_S, MavlinkVehicle
from uavmap.fly.watch_over import watched_over
from uavmap.link.identity import same_aircraft
from uavmap.link.session import ACK_WAIT_S, Session
from uavmap.link.transports import Transport, open_transport
from uavmap.link.urls import parse_url
from uavmap.record.flight_plan import JOURNAL, REHOMED, TLOG, FlightPlan
from uavmap.record.journal import Journal
from uavmap.record.mission_time import Clocks, Marks, last_mark, read_clocks, taken_up_at
from uavmap.record.tlog import TlogWriter
from uavmap.results.score import true_roi
from uavmap.results.write_results import write_results

if TYPE_CHECKING:
    from uavmap.simulation import Truth

LINK_LOST_WALL_S: Final = 2.0
BATTERY_STALE_WALL_S: Final = 5.0
SLACK_WALL_S: Final = 2.0
"""On a clock that runs fast, a busy machine must not look like an aircraft in trouble."""
ACK_WAIT_WALL_S: Final = 0.3


_ENDED: Final = (Phase.FINISHED, Phase.FAILED, Phase.DOWN, Phase.LOST)


def fly(plan: FlightPlan, folder: Path, progress: Progress) -> dict[str, Any]:
    """Fly a new mission into a folder; returns the summary.

    Raises `MissionFileError`, `JournalError`, `LinkError`; `KeyboardInterrupt` when the operator
    leaves before the end.
    """
    setting = plan.setting(progress.say)
    for url in plan.urls:
        parse_url(url)
    with Journal.create(folder / JOURNAL, {"plan": asdict(plan)}) as journal:
        flight = _Flight(plan, setting, folder, journal, State.initial(setting), progress)
        try:
            return flight.run()
        except* LinkError:
            if not len(journal):  # nobody answered: nothing has begun
                journal.discard()
                (folder / TLOG).unlink(missing_ok=True)
                with contextlib.suppress(OSError):
                    folder.rmdir()
            raise


def resume(
    folder: Path,
    progress: Progress,
    *,
    urls: tuple[str, ...] = (),
    from_home: bool = False,
    ask: Callable[[str], bool] | None = None,
) -> dict[str, Any]:
    """Go on with the mission of a folder; returns the summary.

    A simulated world died with its process: it is made again by flying the recorded flight once
    more, and every event must come out as recorded, byte for byte. With `from_home` the aircraft
    stand at home with full batteries instead, as after a failsafe brought them back, and only
    the journal tells what is known; that is also how real aircraft are taken up. `ask` puts a
    question to the operator, where there is one.
    """
    with Journal.open(folder / JOURNAL) as journal:
        plan = FlightPlan.read(journal)
        if urls:
            plan = replace(plan, urls=urls)
        setting = plan.setting(progress.say)
        state = fold(setting, journal.events())
        progress.say(
            f"{folder}: {len(journal)} events, mission time {state.t_s:.0f} s, "
            f"{len(state.belief.roi)} ROI cells"
        )
        if state.over and state.completed:
            progress.say("the mission is completed already; writing its results anew")
            return _results(plan, setting, folder, journal, None)
        again = plan.simulated and not (from_home or plan.rehomed)
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
        flight = _Flight(plan, setting, folder, journal, state, progress, again=again)
        flight.ask = ask
        return flight.run()


class _Flight:
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
        self._resumed = len(journal) > 0 and not again
        self._start_s = state.t_s
        self._marks = None if plan.simulated else Marks(journal, self._clocks)
        self._vehicle_clock: Callable[[], float | None] = lambda: None
        self.ask: Callable[[str], bool] | None = None
        """Puts a question to the operator, where there is one."""
        self._truth: Truth | None = None

    def run(self) -> dict[str, Any]:
        """Fly and write the results."""
        clock: Clock
        if self._plan.simulated:
            clock = VirtualClock(self._plan.speedup)
            run(self._fly_simulated(), clock)
        else:
            clock = ScaledClock(self._plan.speedup or 1.0)
            run(self._fly_connected(), clock)
        return _results(self._plan, self._setting, self._folder, self._journal, self._truth)

    def _now_s(self) -> float:
        """Mission time."""
        return self._start_s + asyncio.get_running_loop().time()

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
        self._start_s = start_s - asyncio.get_running_loop().time()

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
            sessions = [
                simulation.open_session(index, log.record)
                for index in range(len(simulation.names()))
            ]
            async with asyncio.TaskGroup() as tasks:
                world = tasks.create_task(simulation.run())
                fetches = [simulation.fetch] * len(sessions)
                await self._serve(simulation.names(), sessions, fetches)
                world.cancel()

    # --- connected -------------------------------------------------------------------------
    async def _fly_connected(self) -> None:
        async with contextlib.AsyncExitStack() as stack:
            log = stack.enter_context(self._log())
            ack_wait_s = max(ACK_WAIT_S, ACK_WAIT_WALL_S * (self._plan.speedup or 1.0))
            opened = [
                await stack.enter_async_context(
                    _connected(url, log.record, ack_wait_s, self._progress.say)
                )
                for url in self._plan.urls
            ]
            fetches = [self._fetcher(transport) for _, transport in opened]
            await self._serve(list(self._plan.urls), [session for session, _ in opened], fetches)

    def _fetcher(self, transport: Transport) -> PictureFetcher:
        """For the pictures of the vehicle at the other end of a link."""
        named = self._setting.mission.camera.hosts
        return PictureFetcher(lambda: (*named, transport.peer_host or ""))

    def _link_lost_s(self) -> float:
        """On a clock that runs fast, a busy machine must not look like a lost link."""
        if self._plan.simulated:
            return LINK_LOST_S
        return max(LINK_LOST_S, LINK_LOST_WALL_S * (self._plan.speedup or 1.0))

    def _classifier(self, number: int) -> Classifier:
        mission = self._setting.mission
        return Classifier.of(mission, self._setting.grid, mission.altitude_m(number - 1))

    # --- both ------------------------------------------------------------------------------
    def _vehicles(
        self, names: list[str], sessions: list[Session], fetches: Sequence[Fetch], crew: Crew
    ) -> dict[int, MavlinkVehicle]:
        """The driver of each vehicle, by number."""
        at_a_terminal = not (crew.absent or self._plan.simulated or self._plan.auto_swap)
        speedup = max(self._plan.speedup or 1.0, 1.0)
        stale_s = BATTERY_STALE_S
        if not self._plan.simulated:
            stale_s = max(stale_s, BATTERY_STALE_WALL_S * speedup)
        for number, session in enumerate(sessions, start=1):
            session.view.expect_near(self._setting.mission.home)
            session.view.gate.say = partial(_say_of, self._progress, number)
        return {
            number: MavlinkVehicle(
                number,
                name,
                session,
                CameraDriver(number, session, self._classifier(number), fetch, self._now_s),
                self._setting,
                self._now_s,
                crew.swap,
                self._link_lost_s(),
                battery_stale_s=stale_s,
                ground_patience_s=None if at_a_terminal else ON_GROUND_S,
                slack_s=0.0 if self._plan.simulated else SLACK_WALL_S * (speedup - 1.0),
                tell=self._progress.say,
            )
            for number, (name, session, fetch) in enumerate(
                zip(names, sessions, fetches, strict=True), start=1
            )
        }

    async def _serve(
        self, names: list[str], sessions: list[Session], fetches: Sequence[Fetch]
    ) -> None:
        """Fly the mission, and look after the aircraft however that ends."""
        automatic = self._plan.simulated or self._plan.auto_swap
        crew = Crew(self._progress.say, automatic=automatic)
        vehicles = self._vehicles(names, sessions, fetches, crew)

        def observe(event: Event, state: State) -> None:
            if self._marks is not None:
                self._marks.note(self._now_s())
            self._progress.update(event, state, again=self._journal.expected)
            if crew.absent and _all_wait(state, crew.waiting):
                self._progress.say(
                    f"swap the batteries, then `uavmap resume {self._folder}` goes on"
                )
                service.stop()

        service = Service(
            self._setting, self._journal, vehicles, self._state, observe, self._progress.say
        )
        self._progress.begin(self._setting, again=self._again)
        guardians = [vehicle.guardian for vehicle in vehicles.values()]
        try:
            with self._interrupts(service):
                self._state = await watched_over(
                    guardians, self._fly(vehicles, service), leave=not self._plan.simulated
                )
        except BaseException:
            with contextlib.suppress(Exception):  # whatever else is wrong, that comes first
                if len(self._journal):
                    self._progress.say(f"to go on: uavmap resume {self._folder}")
            raise
        finally:
            self._progress.end()

    async def _fly(self, vehicles: dict[int, MavlinkVehicle], service: Service) -> State:
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
        _each_its_own(vehicles)
        self._vehicle_clock = lambda: vehicles[1].view.since_boot_s
        if self._resumed:
            if not self._plan.simulated:
                await self._settle_time()
            service.post(Resumed(round(self._now_s(), 3)))
        return await service.fly()

    @contextlib.contextmanager
    def _interrupts(self, service: Service) -> Any:
        """Ctrl-C once brings real aircraft home; a second time their autopilots do.

        A simulated flight just stops: nobody is in the air.
        """
        if self._plan.simulated:
            yield
            return
        loop = asyncio.get_running_loop()
        task = asyncio.current_task()
        presses = 0

        def interrupted() -> None:
            nonlocal presses
            presses += 1
            if presses == 1 and service.flying:
                self._progress.say(
                    "coming home and landing; press Ctrl-C again to leave that to the autopilots"
                )
                service.recall()
            elif task is not None:
                task.cancel()

        numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        for number in numbers:
            loop.add_signal_handler(number, interrupted)
        try:
            yield
        except asyncio.CancelledError:
            raise KeyboardInterrupt from None
        finally:
            for number in numbers:
                loop.remove_signal_handler(number)


def _each_its_own(vehicles: dict[int, MavlinkVehicle]) -> None:
    """Raise `LinkError` where two links lead to one aircraft: it would be told two things at once.

    Seen after both have answered; a router that forwards several vehicles may do that.
    """
    for (_, one), (_, other) in itertools.combinations(vehicles.items(), 2):
        if same_aircraft(one.view, other.view):
            raise LinkError(
                f"{one.name} and {other.name} lead to the same aircraft (system "
                f"{one.view.system_id}); give every vehicle a link and a system id of its own"
            )


def _all_wait(state: State, waiting: set[int]) -> bool:
    """Whether everybody who is not done waits for a battery that nobody here will announce."""
    return bool(waiting) and all(
        number in waiting or v.phase in _ENDED for number, v in state.vehicles.items()
    )


def _say_of(progress: Progress, number: int, text: str) -> None:
    """A line about one vehicle."""
    progress.say(f"vehicle {number}: {text}")


@contextlib.asynccontextmanager
async def _connected(
    url: str, record: Callable[[bytes], None], ack_wait_s: float, say: Callable[[str], None]
) -> AsyncIterator[tuple[Session, Transport]]:
    """A session over the transport that a URL names."""
    opened: list[Transport] = []

    def send(frame: bytes) -> None:
        for transport in opened:
            transport.send(frame)

    session = Session(send, record, ack_wait_s)
    async with open_transport(parse_url(url), session.feed, say) as transport:
        opened.append(transport)
        yield session, transport


def _results(
    plan: FlightPlan, setting: Setting, folder: Path, journal: Journal, truth: Truth | None
) -> dict[str, Any]:
    """Write the results; what the simulator watched is kept for when they are written anew."""
    if truth is not None:
        journal.put_meta("truth", truth.figures())
    roi = None
    if plan.simulated and setting.mission.sim.roi:
        roi = true_roi(setting.mission, setting.grid)
    seed = plan.seed if plan.simulated else None
    events = list(journal.events())
    try:
        return write_results(folder, setting, events, seed, journal.meta.get("truth"), roi)
    except OSError as error:
        raise OutputError(
            f"{folder}: the results cannot be written ({error.strerror}); the journal is whole: "
            f"make room, and `uavmap resume {folder}` writes them"
        ) from None
