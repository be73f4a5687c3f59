"""Simulated vehicles for tests of MAVLink software, as the pytest fixtures return them.

In virtual time `run` and `until` let time pass as fast as it computes, and `send` and `receive`
exchange messages without a socket. The first use of `url` puts the vehicles on loopback sockets;
from then on they fly in a background thread, faster than real time.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import Framer, Message, Packer
from sitl.scenario import Setup
from sitl.sockets.server import Background
from sitl.vehicle import SimVehicle, VehicleTruth

if TYPE_CHECKING:
    from sitl.faults.faults import Faults

STEP_S = 0.05
_LOOK_S = 0.005  # interval of checks on a socket, wall time
_STUCK_S = 20.0  # wall time in which the simulation has to get on
_TEXTS = 5

T = TypeVar("T")


class Vehicle:
    """One simulated vehicle as a test sees it: a client's end of the link, and the truth."""

    def __init__(self, fleet: Fleet, vehicle: SimVehicle) -> None:
        self.fleet = fleet
        """Its fleet, which shares its time."""
        self._vehicle = vehicle
        self._unread = bytearray()
        self._messages: deque[Message] = deque()
        self._framer = Framer()
        self._wire = Packer(255, mav.MAV_COMP_ID_MISSIONPLANNER)
        self._texts: deque[str] = deque(maxlen=_TEXTS)

    @property
    def system_id(self) -> int:
        """Its MAVLink system id; the autopilot is component 1, the camera 100."""
        return self._vehicle.spec.system_id

    @property
    def truth(self) -> VehicleTruth:
        """True state: `position`, `height_m`, `velocity_m_s`, `mode`, `armed`, ..."""
        return self.fleet.ask(lambda: self._vehicle.truth)

    @property
    def fail(self) -> Faults:
        """Its faults: `sitl.fail.gps(after_s=30)`; see `sitl.faults.faults`."""
        return self._vehicle.fail

    @property
    def t_s(self) -> float:
        """Seconds since boot, on the vehicle's own time."""
        return self._vehicle.t_s

    def image(self, url: str) -> bytes | None:
        """Return the JPEG of a `file_url` in CAMERA_IMAGE_CAPTURED, None if there is none."""
        return self.fleet.ask(lambda: self._vehicle.image(url))

    # --- virtual time ---------------------------------------------------------------------------

    def send(self, message: Message | bytes) -> None:
        """Send a MAVLink message as ground station (255, 190), or the bytes of frames as they are.

        The answers can be received at once.
        """
        self.fleet.need_virtual_time("send")
        data = message if isinstance(message, bytes) else self._wire.pack(message)
        self._unread += self._vehicle.receive(data)

    def receive(self) -> list[Message]:
        """Return what the vehicle has sent since the last call, oldest first."""
        self._decode()
        messages = list(self._messages)
        self._messages.clear()
        return messages

    def receive_bytes(self) -> bytes:
        """Return the same as frames, for a client that decodes them itself."""
        self.fleet.need_virtual_time("receive")
        data = bytes(self._unread)
        self._unread.clear()
        return data

    def ground_station(self) -> None:
        """Send a ground station's heartbeat: a PX4 sends its texts only to known stations.

        A real one drops a station after 2.5 s without a heartbeat.
        """
        self.send(mav.MAVLink_heartbeat_message(mav.MAV_TYPE_GCS, 8, 0, 0, 4, 3))

    def expect(self, kind: str, timeout_s: float = 10.0, **fields: Any) -> Message:
        """Return the next message of a kind with such fields; drop those before it.

        Lets time pass until it comes. Raises `TimeoutError` if it does not come.
        """

        def find() -> Message | None:
            self._decode()
            while self._messages:
                message = self._messages.popleft()
                if message.get_type() == kind and all(
                    getattr(message, name) == value for name, value in fields.items()
                ):
                    return message
            return None

        return self.fleet.wait(find, timeout_s, f"{kind} {fields or ''}".strip(), self)

    def command(self, command: int, *p: float, timeout_s: float = 10.0) -> int:
        """Send COMMAND_LONG with up to seven parameters; return its final MAV_RESULT."""
        filled = (*p, *([0.0] * (7 - len(p))))
        self.send(mav.MAVLink_command_long_message(self.system_id, 1, command, 0, *filled))
        while True:
            result = int(self.expect("COMMAND_ACK", timeout_s, command=command).result)
            if result != mav.MAV_RESULT_IN_PROGRESS:
                return result

    def run(self, seconds: float) -> None:
        """Let time pass, for the whole fleet."""
        self.fleet.run(seconds)

    def until(self, predicate: Callable[[], T], timeout_s: float = 120.0) -> T:
        """Let time pass until `predicate()` is true; return its value.

        Raises `TimeoutError`, with what the vehicle is doing, after `timeout_s` of vehicle time.
        """
        return self.fleet.wait(predicate, timeout_s, "the predicate", self)

    # --- sockets --------------------------------------------------------------------------------

    @property
    def url(self) -> str:
        """URL for a client; the first use puts the whole fleet on sockets."""
        return self.fleet.urls[self.fleet.vehicles.index(self)]

    # --- inside ---------------------------------------------------------------------------------

    def keep(self, data: bytes) -> None:
        """Keep what the vehicle has sent."""
        self._unread += data

    def describe(self) -> str:
        """Return a line on what it is doing, for an error."""
        truth = self.truth
        doing = (
            f"vehicle {self.system_id} at {truth.t_s:.1f} s: {truth.mode.name}, "
            f"{'armed' if truth.armed else 'disarmed'}, {truth.height_m:.1f} m high"
        )
        if self.fleet.serving:  # its frames go to its clients
            return doing
        self._decode()
        return f"{doing}; its texts: {'; '.join(self._texts) or 'none'}"

    def _decode(self) -> None:
        for message in self._framer.feed(self.receive_bytes()):
            self._messages.append(message)
            if message.get_type() == "STATUSTEXT":
                self._texts.append(message.text)


class Fleet(Sequence[Vehicle]):
    """Vehicles in one world and on one clock; `fleet[0]` is the first."""

    def __init__(self, setup: Setup | None = None) -> None:
        self.setup = Setup() if setup is None else setup
        simulated = self.setup.build()
        self.vehicles = tuple(Vehicle(self, vehicle) for vehicle in simulated)
        self._simulated = simulated
        self._background: Background | None = None

    def __len__(self) -> int:
        return len(self.vehicles)

    def __getitem__(self, index: Any) -> Any:
        return self.vehicles[index]

    def __iter__(self) -> Iterator[Vehicle]:
        return iter(self.vehicles)

    @property
    def serving(self) -> bool:
        """True if it is on sockets, where time passes by itself."""
        return self._background is not None

    @property
    def t_s(self) -> float:
        """Seconds since boot."""
        return self._simulated[0].t_s

    @property
    def urls(self) -> list[str]:
        """URLs for clients, in the vehicles' order; the first use puts them on sockets."""
        if self._background is None:
            self._background = Background(
                self._simulated, speedup=self.setup.speedup, tcp=self.setup.tcp
            )
        return list(self._background.urls)

    def run(self, seconds: float) -> None:
        """Let time pass."""
        if not (math.isfinite(seconds) and seconds >= 0.0):
            raise ValueError(f"time goes forward: {seconds}")
        if self._background is not None:
            end_s = self.t_s + seconds
            self.wait(lambda: self.t_s >= end_s, math.inf, f"{seconds} s", self.vehicles[0])
            return
        whole, rest_s = divmod(seconds + 1e-9, STEP_S)
        for _ in range(int(whole)):
            self._step(STEP_S)
        if rest_s > 1e-6:
            self._step(rest_s)

    def until(self, predicate: Callable[[], T], timeout_s: float = 120.0) -> T:
        """Let time pass until `predicate()` is true; see `Vehicle.until`."""
        return self.wait(predicate, timeout_s, "the predicate", self.vehicles[0])

    def close(self) -> None:
        """End the background thread and close its sockets."""
        if self._background is not None:
            self._background.close()

    # --- inside ---------------------------------------------------------------------------------

    def wait(self, look: Callable[[], T | None], timeout_s: float, what: str, asker: Vehicle) -> T:
        """Let time pass until `look` returns something true."""
        due_s = self.t_s + timeout_s
        moved_s, moved_at_s = self.t_s, time.monotonic()
        while not (found := look()):
            if self.t_s >= due_s - 1e-6:
                raise TimeoutError(
                    f"{what} did not come within {timeout_s:g} s of vehicle time; "
                    f"{asker.describe()}"
                )
            if self._background is None:
                self._step(STEP_S)
                continue
            self._background.check()
            time.sleep(_LOOK_S)
            if self.t_s > moved_s:
                moved_s, moved_at_s = self.t_s, time.monotonic()
            elif time.monotonic() - moved_at_s > _STUCK_S:
                raise TimeoutError(f"the simulation has stood still for {_STUCK_S:g} s")
        return found

    def ask(self, question: Callable[[], T]) -> T:
        """Return the answer to a question, asked between two steps."""
        return question() if self._background is None else self._background.ask(question)

    def need_virtual_time(self, what: str) -> None:
        """Raise `RuntimeError` on sockets."""
        if self._background is not None:
            raise RuntimeError(f"{what}: this vehicle is on a socket, connect a client to its url")

    def _step(self, dt_s: float) -> None:
        for handle, vehicle in zip(self.vehicles, self._simulated, strict=True):
            handle.keep(vehicle.step(dt_s))
