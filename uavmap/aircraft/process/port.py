"""The mission's end: orders become messages, and messages become events of the mission."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any, Final

import missions.errors
from missions.errors import LinkError, NotFlownError, UavmapError
from missions.events import Event, FrameSeen, LinkLost, Recalled
from missions.orders import Order
from uavmap.aircraft.imaging.classifier import PictureJudge, PosedPicture
from uavmap.aircraft.process import messages as msg
from uavmap.base import messages

DEFECT: Final = "defect"
LAST_REPORT: Final = (
    "this was its last report, and no program flies it now: take it by radio control, or its "
    "autopilot's failsafes decide"
)


class Port:
    """The port between a mission and its aircraft; it sends messages once `connect` was called.

    Args:
        post: Takes an event to the mission.
        taken_in: Returns when all posted events were handled, and their orders given.
        swap: Returns when the crew has swapped a battery.
        ask: Asks the operator a question; None without an operator.
        hear: Receives the vehicles' reports beside events.
    """

    def __init__(
        self,
        vehicles: Sequence[int],
        now_s: Callable[[], float],
        judge: PictureJudge,
        post: Callable[[Event], None],
        taken_in: Callable[[], Awaitable[None]],
        swap: Callable[[int], Awaitable[None]],
        ask: Callable[[str], Awaitable[bool | None]],
        hear: Sequence[Callable[[msg.Telemetry], None]] = (),
    ) -> None:
        loop = asyncio.get_running_loop()
        self._log = messages.bound("uavmap.flight")
        self._vehicles = vehicles
        self._now_s = now_s
        self._judge = judge
        self._post = post
        self.taken_in = taken_in
        self._swap = swap
        self._ask = ask
        self._followers = hear
        self._send: Callable[[msg.Message], None] | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._swaps: dict[int, asyncio.Task[None]] = {}
        self._fly: msg.Fly | None = None
        self._last: msg.Finish | msg.Leave | None = None
        """The mission's last message."""
        self._received = 0
        """Number of the last event of this process of the aircraft."""
        self.kept = 0
        """Number of the last event that is in the journal."""
        self._keeping: asyncio.Task[None] | None = None
        self._boot: tuple[float, float] | None = None
        """Time since the first vehicle was switched on, and the loop's time of that report, s."""
        self._fates: Mapping[int, str] = {}
        """Last reported fate of each vehicle."""
        self.ready: asyncio.Future[msg.Ready] = loop.create_future()
        self.ended: asyncio.Future[msg.Ended] = loop.create_future()

    def connect(self, send: Callable[[msg.Message], None]) -> None:
        """Send messages by this function from now on."""
        self._send = send

    def send(self, message: msg.Message) -> None:
        """Send a message; drop it once the aircraft have ended."""
        if self._send is not None and not self.ended.done():
            self._send(message)

    # --- to the aircraft ------------------------------------------------------------------------
    def give(self, vehicle: int, order: Order) -> None:
        """Have a vehicle carry out an order instead of the present one."""
        self.send(msg.GiveOrder(vehicle, order))

    def land_here(self, vehicle: int, reason: str) -> None:
        """Have a vehicle land in place."""
        self.send(msg.LandHere(vehicle, reason))

    async def begun(self, begin: msg.Begin) -> msg.Ready:
        """Begin, and wait until the vehicles are ready. Raises the reason that prevents it."""
        self.send(begin)
        either: list[asyncio.Future[Any]] = [self.ready, self.ended]
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        if not self.ready.done():
            raise error_of(self.ended.result())
        return self.ready.result()

    def fly(self, start_s: float) -> None:
        """Have vehicles report and fly; the loop's clock was zero at mission time `start_s`."""
        self._fly = msg.Fly(start_s)
        self.send(self._fly)

    def report_loss(self) -> None:
        """Report every link as lost: the process of the aircraft has died."""
        for vehicle in self._vehicles:
            self._post(LinkLost(vehicle, round(self._now_s(), 3)))
        for task in self._swaps.values():
            task.cancel()
        self._swaps.clear()
        if self._keeping is not None:
            self._keeping.cancel()
            self._keeping = None
        self._received = self.kept = 0

    def let_go(self) -> None:
        """Drop the last reports here: another process has the vehicles."""
        self._fates = {}

    @property
    def since_boot_s(self) -> float | None:
        """Time since the first vehicle was switched on, s; None if it is not reported."""
        if self._boot is None:
            return None
        boot_s, at_s = self._boot
        return boot_s + asyncio.get_running_loop().time() - at_s

    # --- from the aircraft ----------------------------------------------------------------------
    def receive(self, message: msg.Message) -> None:
        """Handle a message."""
        match message:
            case msg.EventReport() if message.serial > self._received:
                self._received = message.serial
                self._post(message.event)
                if self._keeping is None or self._keeping.done():
                    self._keeping = self._begin(self._keep())
            case msg.Telemetry():
                for hear in self._followers:
                    hear(message)
            case msg.Picture():
                self._begin(self._send_verdict(message))
            case msg.SwapRequested():
                self._swaps[message.vehicle] = self._begin(self._confirm_swap(message.vehicle))
            case msg.SwapCancelled():
                if message.vehicle in self._swaps:
                    self._swaps.pop(message.vehicle).cancel()
            case msg.Question():
                self._begin(self._ask_operator(message.text))
            case msg.Line():
                self._log.info(message.text)
            case msg.Ready() | msg.Beat():
                if message.boot_s is not None:
                    self._boot = (message.boot_s, asyncio.get_running_loop().time())
                if isinstance(message, msg.Ready):
                    self._receive_ready(message)
                else:
                    self._fates = {**self._fates, **message.fates}
            case msg.Recall():
                self._log.info("the process of the aircraft is asked to end: coming home, landing")
                self._post(Recalled(round(self._now_s(), 3)))
            case msg.Ended():
                if not self.ended.done():
                    self.ended.set_result(message)

    def _receive_ready(self, message: msg.Ready) -> None:
        if not self.ready.done():
            self.ready.set_result(message)
        elif self._fly is not None:  # another process, or another connection
            self.send(self._fly)
            if self._last is not None:
                self.send(self._last)

    def _begin(self, work: Any) -> asyncio.Task[None]:
        task: asyncio.Task[None] = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def _keep(self) -> None:
        while self.kept < self._received:
            received = self._received
            await self.taken_in()
            self.kept = received

    async def _send_verdict(self, picture: msg.Picture) -> None:
        verdict = self._judge.verdict(
            PosedPicture(
                picture.vehicle, picture.t_s, picture.pose, picture.vantage, picture.anywhere,
                picture.name, picture.content,
            )
        )  # fmt: skip
        self._post(verdict)
        await self.taken_in()
        self.send(msg.PictureJudged(picture.serial, isinstance(verdict, FrameSeen)))

    async def _confirm_swap(self, vehicle: int) -> None:
        await self._swap(vehicle)
        self._swaps.pop(vehicle, None)
        self.send(msg.SwapDone(vehicle))

    async def _ask_operator(self, question: str) -> None:
        self.send(msg.Answered(await self._ask(question)))

    def close(self) -> None:
        """Cancel all judging, waiting and questions."""
        for task in self._tasks:
            task.cancel()

    # --- the end, as `uavmap.aircraft.guardian.last_watch` asks for it ---------------------------
    async def run(self) -> None:
        """Wait for an end that the mission has not requested; raise its reason."""
        raise error_of(await asyncio.shield(self.ended))

    async def bring_home(self, reason: str) -> None:
        """Have every vehicle that is in the air return, and wait until all are down."""
        self._end(msg.Finish(reason))
        await asyncio.shield(self.ended)

    async def leave(self, reason: str) -> None:
        """Have every autopilot return its vehicle, and wait only until that is seen."""
        self._end(msg.Leave(reason))
        await asyncio.shield(self.ended)

    def _end(self, last: msg.Finish | msg.Leave) -> None:
        self._last = last
        self.send(last)

    def fates(self) -> Mapping[int, str]:
        """Return where each received vehicle is, as text; its last report if it is silent."""
        found = self.ended.result().fates if self.ended.done() else {}
        last = {n: fate and f"{fate}; {LAST_REPORT}" for n, fate in self._fates.items()}
        return {**last, **found}


def error_of(ended: msg.Ended) -> Exception:
    """Return the error that ended the aircraft's part."""
    if ended.error == NotFlownError.__name__:
        return NotFlownError(ended.text, could_fly=ended.could_fly)
    kind = getattr(missions.errors, ended.error or "", None)
    if isinstance(kind, type) and issubclass(kind, UavmapError):
        return kind(ended.text)
    if ended.error is None:
        return LinkError("the process of the aircraft was asked to end, before the mission has")
    return RuntimeError(ended.text)


def ended_by(failure: BaseException | None, fates: Mapping[int, str], text: str) -> msg.Ended:
    """Return the last message after a failure, described by `text`."""
    if failure is None:
        return msg.Ended(dict(fates))
    name = type(failure).__name__ if isinstance(failure, UavmapError) else DEFECT
    could_fly = isinstance(failure, NotFlownError) and failure.could_fly
    return msg.Ended(dict(fates), name, text, could_fly)
