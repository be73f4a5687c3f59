"""The aircraft's end: orders become calls of vehicles, and their reports become messages."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable, Mapping
from typing import Literal, Protocol, TypeVar

import numpy as np

from missions.errors import ImageError
from missions.events import Event
from missions.orders import Hold, Order
from uavmap.aircraft.imaging.classifier import PosedPicture
from uavmap.aircraft.process import messages as msg
from uavmap.aircraft.reporter import Report

M = TypeVar("M")


class Vehicle(Protocol):
    """The interface of a vehicle for the host."""

    async def run(self, report: Report) -> None:
        """Report, and carry out orders, until cancelled."""

    def give(self, order: Order) -> None:
        """Carry out an order instead of the present one."""

    def land_here(self, reason: str) -> bool:
        """Have its guardian land it in place, if it is in the air and under our control."""

    def report_again(self) -> None:
        """Report its position, for a mission that has been away."""


class Host:
    """The host between the vehicles of a service and the mission; `send` takes its messages."""

    def __init__(self, send: Callable[[msg.Message], None]) -> None:
        loop = asyncio.get_running_loop()
        self._send = send
        self._vehicles: Mapping[int, Vehicle] = {}
        self._serials = itertools.count(1)
        self._events = itertools.count(1)
        self._pictures: dict[int, asyncio.Future[bool]] = {}
        self._swaps: dict[int, asyncio.Future[None]] = {}
        self.ready: msg.Ready | None = None
        """Message that was sent when the vehicles were ready."""
        self._answer: asyncio.Future[bool | None] | None = None
        self._begun: asyncio.Future[msg.Begin] = loop.create_future()
        self._flown: asyncio.Future[msg.Fly] = loop.create_future()
        self.end: asyncio.Future[msg.Finish | msg.Leave] = loop.create_future()
        """The mission's last message."""
        self.left: asyncio.Future[msg.Leave] = loop.create_future()
        """Message of an operator who does not wait."""

    # --- from the mission -----------------------------------------------------------------------
    def receive(self, message: msg.Message) -> None:
        """Carry out a message."""
        match message:
            case msg.GiveOrder():
                if message.vehicle in self._vehicles:
                    self._vehicles[message.vehicle].give(message.order)
            case msg.PictureJudged():
                _settle(self._pictures.pop(message.serial, None), message.seen)
            case msg.LandHere():
                if message.vehicle in self._vehicles:
                    self._vehicles[message.vehicle].land_here(message.reason)
            case msg.SwapDone():
                _settle(self._swaps.pop(message.vehicle, None), None)
            case msg.Answered():
                _settle(self._answer, message.yes)
            case msg.Begin():
                _settle(self._begun, message)
            case msg.Fly() if self._flown.done():  # the mission is back
                for vehicle in self._vehicles.values():
                    vehicle.report_again()
            case msg.Fly():
                self._flown.set_result(message)
            case msg.Finish():
                _settle(self.end, message)
            case msg.Leave():
                _settle(self.end, message)
                _settle(self.left, message)

    async def begin(self) -> msg.Begin:
        """Wait for the first message of the mission."""
        return await self._begun

    async def fly(self, vehicles: Mapping[int, Vehicle], ready: msg.Ready) -> msg.Fly:
        """Report that the vehicles are ready, and wait until the mission has set its time."""
        self._vehicles = vehicles
        self.ready = ready
        self._send(ready)
        return await self._flown

    async def carry_out(self) -> msg.Finish | msg.Leave:
        """Carry out orders until the mission's last message."""
        try:
            async with asyncio.TaskGroup() as tasks:
                running = [tasks.create_task(v.run(self.report)) for v in self._vehicles.values()]
                end = await self.end
                for task in running:
                    task.cancel()
            return end
        finally:  # their guardians have them
            self._vehicles = {}

    # --- a mission that is away -----------------------------------------------------------------
    def hold(self) -> None:
        """Have each vehicle hold, and wait for nothing of the mission, which is gone."""
        for vehicle in self._vehicles.values():
            vehicle.give(Hold())

    @property
    def state(self) -> Literal["new", "flying", "returning"]:
        """State for a mission that connects now."""
        if not self._begun.done() and not self.end.done():
            return "new"
        return "flying" if self._flown.done() and self._vehicles else "returning"

    # --- for the vehicles -----------------------------------------------------------------------
    def report(self, event: Event) -> None:
        """Send an event."""
        self._send(msg.EventReport(event, next(self._events)))

    def line(self, text: str) -> None:
        """Send a line for the operator."""
        self._send(msg.Line(text))

    async def judge(self, taken: PosedPicture) -> bool:
        """Have a picture judged by the mission. Raises `ImageError` for one that is too large."""
        size = len(taken.data) if isinstance(taken.data, bytes) else taken.data.nbytes
        if size > msg.MAX_PICTURE_BYTES:
            most = msg.MAX_PICTURE_BYTES
            raise ImageError(f"{taken.name}: {size} bytes; a picture has at most {most}")
        serial = next(self._serials)
        waiting: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._pictures[serial] = waiting
        data, shape = taken.data, None
        if not isinstance(data, bytes):
            rows, columns, channels = data.shape
            shape, data = (rows, columns, channels), np.ascontiguousarray(data).tobytes()
        self._send(
            msg.Picture(
                serial, taken.vehicle, taken.t_s, taken.pose, taken.vantage, taken.anywhere,
                taken.name, shape, data,
            )
        )  # fmt: skip
        try:
            return await waiting
        finally:
            self._pictures.pop(serial, None)

    async def swap(self, vehicle: int) -> None:
        """Wait until the crew has swapped the battery of a vehicle."""
        swapped = self._swaps[vehicle] = asyncio.get_running_loop().create_future()
        self._send(msg.SwapRequested(vehicle))
        try:
            await swapped
        finally:
            if self._swaps.pop(vehicle, None) is not None:
                self._send(msg.SwapCancelled(vehicle))

    async def ask(self, question: str) -> bool | None:
        """Ask the operator; return None without one."""
        self._answer = asyncio.get_running_loop().create_future()
        self._send(msg.Question(question))
        return await self._answer


def _settle(future: asyncio.Future[M] | None, result: M) -> None:
    if future is not None and not future.done():
        future.set_result(result)
