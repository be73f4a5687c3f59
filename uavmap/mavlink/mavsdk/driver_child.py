"""MAVSDK in a process of its own: bytes of one vehicle's link in and out, and requests.

    python -m uavmap.mavlink.mavsdk.driver_child SYSTEM COMPONENT

It has no connection: the service passes it the link's bytes, and carries its output. So it sends
nothing when the service has died or hangs. It ends when its input ends.

In (JSON): {"id", "do", ...}. Out: {"ready": version}; {"system": n} when MAVSDK knows a vehicle;
{"id", "result"} with MAVSDK's own result, and the answer's fields for a command; {"name", "system",
"component", "fields"} for each message of the vehicle.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, BinaryIO, Final

from mavsdk.exceptions import MavsdkError
from mavsdk.logging import log_subscribe
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.system import System

from uavmap.mavlink.mavsdk.driver_pipe import FRAMES, Pieces, frames_piece, object_piece

AT_ONCE: Final = 8
"""Maximum number of commands that may wait for their answers."""
_READ_BYTES: Final = 1 << 16
ORPHAN_S: Final = 1.0
"""Interval to check that the service is alive, s."""


class _Out:
    """The output to the service; several threads write."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._lock = threading.Lock()

    def write(self, piece: bytes) -> None:
        """Write a piece; if the service is gone, end this process."""
        try:
            with self._lock:
                self._file.write(piece)
                self._file.flush()
        except (OSError, ValueError):
            os._exit(0)


class _Child:
    """MAVSDK and one vehicle."""

    def __init__(self, system: int, component: int, out: _Out) -> None:
        self._out = out
        self._ours = (system, component)
        self._vehicle: System | None = None
        self._direct: MavlinkDirect | None = None
        self._action: Action | None = None
        self._workers = ThreadPoolExecutor(AT_ONCE)
        self._mavsdk = Mavsdk(Configuration.create_manual(system, component, False))
        self._mavsdk.subscribe_raw_bytes_to_be_sent(lambda data: out.write(frames_piece(data)))
        self._mavsdk.add_any_connection_with_handle("raw://")
        self._mavsdk.first_autopilot_async(-1.0, self._note_vehicle)
        out.write(object_piece({"ready": self._mavsdk.version()}))

    def _note_vehicle(self, vehicle: System | None) -> None:
        """Note a vehicle; called on a thread of MAVSDK, which accepts no requests there."""
        if vehicle is not None:
            self._workers.submit(self._begin_with, vehicle)

    def _begin_with(self, vehicle: System) -> None:
        self._vehicle, self._direct = vehicle, MavlinkDirect(vehicle)
        self._action = Action(vehicle)
        self._direct.subscribe_message("", lambda message, _: self._forward(message))
        self._out.write(object_piece({"system": vehicle.get_system_id()}))

    def _forward(self, message: MavlinkMessage) -> None:
        self._out.write(
            object_piece(
                {
                    "name": message.message_name,
                    "system": message.system_id,
                    "component": message.component_id,
                    "fields": json.loads(message.fields_json),
                }
            )
        )

    def receive(self, data: bytes) -> None:
        """Pass bytes from the link to MAVSDK."""
        self._mavsdk.pass_received_raw_bytes(data)

    def do(self, asked: dict[str, Any]) -> None:
        """Carry out a request: a message at once, a question in a thread."""
        if asked["do"] == "send":
            self._answer(asked, self._send)
        else:
            self._workers.submit(self._answer, asked, self._carry_out)

    def _answer(self, asked: dict[str, Any], how: Callable[[dict[str, Any]], Any]) -> None:
        answer: dict[str, Any] = {"id": asked["id"], "result": "SUCCESS"}
        try:
            if self._vehicle is None:
                answer["result"] = "NO_SYSTEM"
            elif (content := how(asked)) is not None:
                answer["answer"] = content
        except MavsdkError as error:
            answer["result"] = getattr(getattr(error, "result", None), "name", str(error))
        except Exception as error:  # the service has to receive any error
            answer["result"] = f"{type(error).__name__}: {error}"
        self._out.write(object_piece(answer))

    def _message(self, asked: dict[str, Any]) -> MavlinkMessage:
        fields = asked["fields"]
        return MavlinkMessage(
            asked["name"],
            *self._ours,
            fields.get("target_system", 0),
            fields.get("target_component", 0),
            json.dumps(fields),
        )

    def _send(self, asked: dict[str, Any]) -> None:
        assert self._direct is not None
        self._direct.send_message(self._message(asked))

    def _carry_out(self, asked: dict[str, Any]) -> Any:
        assert self._direct is not None
        assert self._action is not None
        action = self._action
        match asked["do"]:
            case "command":
                return json.loads(self._direct.send_command(self._message(asked)).fields_json)
            case "arm" | "hold" | "land" | "return_to_launch" as verb:
                getattr(action, verb)()
            case "set_current_speed":
                action.set_current_speed(asked["speed_m_s"])
            case unknown:
                raise ValueError(f"nothing is called {unknown}")
        return None


def _run(system: int, component: int, source: BinaryIO, out: _Out) -> None:
    child, pieces = _Child(system, component, out), Pieces()
    while data := os.read(source.fileno(), _READ_BYTES):
        for letter, content in pieces.feed(data):
            if letter == FRAMES:
                child.receive(content)
            else:
                child.do(json.loads(content))


def _end_with(parent: int) -> None:
    """End this process with the service, even if it hangs in the library."""
    while os.getppid() == parent:
        time.sleep(ORPHAN_S)
    os._exit(0)


def main() -> None:
    """Serve the pipes until the input ends."""
    source, target = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    # output of the library must not get between the pieces
    os.dup2(2, 1)
    log_subscribe(lambda *_: True)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    with contextlib.suppress(KeyboardInterrupt):
        _run(int(sys.argv[1]), int(sys.argv[2]), source, _Out(target))
    # its threads may wait for answers that are no longer needed
    os._exit(0)


if __name__ == "__main__":
    main()
