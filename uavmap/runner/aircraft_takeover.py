"""The search for an aircraft process: a new one, or one whose mission process died.

`aircraft.json` in the flight's folder holds its port and token, `aircraft.log` its messages without
a mission.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter, ValidationError

from missions.errors import AircraftError, LinkError
from missions.events import Event, to_json
from uavmap.aircraft.process import messages as msg
from uavmap.journal.event_log import Journal

ADDRESS: Final = "aircraft.json"
RECORD: Final = "aircraft.log"
"""Record of the aircraft process without a mission: messages as they would be sent."""
ATTACH_WALL_S: Final = 5.0
POLL_INTERVAL_WALL_S: Final = 0.5
"""Time between two questions whether the vehicles are home, real seconds."""
_LOG: Final = logging.getLogger("uavmap.flight")


@dataclass(frozen=True, slots=True)
class Address:
    """The address of the aircraft process."""

    port: int
    token: str
    start_s: float
    """Time when the clock of its loop was zero, on the monotonic clock of this computer, s."""
    process: int

    @classmethod
    def parse(cls, text: bytes | str) -> Address:
        """Return the address in the text of its file. Raises `ValidationError`."""
        return _ADDRESS.validate_json(text)

    @classmethod
    def read(cls, folder: Path) -> Address | None:
        """Return the address in a folder, None without one."""
        with contextlib.suppress(OSError, ValidationError):
            return cls.parse((folder / ADDRESS).read_bytes())
        return None

    def as_json(self) -> str:
        """Return the text of its file."""
        return _ADDRESS.dump_json(self).decode()


_ADDRESS: Final[TypeAdapter[Address]] = TypeAdapter(Address)


@dataclass(frozen=True, slots=True)
class Attachment:
    """A connection to a process of aircraft."""

    address: Address
    socket: socket.socket


def attach(address: Address) -> tuple[msg.Attached, Attachment] | None:
    """Connect to an aircraft process; None if it is gone. Raises `TimeoutError`."""
    with contextlib.ExitStack() as failed:
        try:
            where = ("127.0.0.1", address.port)
            line = failed.enter_context(socket.create_connection(where, ATTACH_WALL_S))
            line.sendall(msg.encode(msg.Attach(msg.VERSION, address.token)))
            decoder = msg.Decoder()
            while data := line.recv(1):
                for message in decoder.feed(data):
                    if isinstance(message, msg.Attached):
                        failed.pop_all()
                        return message, Attachment(address, line)
        except TimeoutError:
            raise
        except (OSError, LinkError):
            pass
    return None


def take_over_aircraft(folder: Path, journal: Journal) -> Attachment | None:
    """Take over the aircraft of a mission process that died, once they are home.

    None if none fly. Events of the meantime go into the journal. Raises `LinkError` if another
    mission has them, `AircraftError` if Ctrl-C ends the wait.
    """
    found = _attached(folder)
    _keep_record(folder, journal)
    if found is not None:
        _LOG.info("the aircraft process of this flight has the vehicles: they are taken over")
    return found


def _attached(folder: Path) -> Attachment | None:
    returning: msg.Attached | None = None
    try:
        while (address := Address.read(folder)) is not None:
            answer = _answer(folder, address)
            if answer is None:
                (folder / ADDRESS).unlink(missing_ok=True)
                return None
            attached, line = answer
            if attached.state in ("new", "flying"):
                return line
            line.socket.close()
            if attached.state == "refused":
                raise LinkError(f"{folder}: {attached.reason}")
            first, returning = returning is None, attached
            if first:
                _LOG.info(f"{attached.reason}; the flight goes on when that is done")
            time.sleep(POLL_INTERVAL_WALL_S)
    except KeyboardInterrupt:
        if returning is not None:
            _require_home(folder, returning)
        raise
    return None


def _answer(folder: Path, address: Address) -> tuple[msg.Attached, Attachment] | None:
    try:
        return attach(address)
    except TimeoutError:
        with contextlib.suppress(OSError):  # there is none, or it is another user's
            os.kill(address.process, 0)
            raise LinkError(
                f"{folder}: process {address.process}, which has the aircraft, does not "
                f"answer; try again, or end it (kill -9 {address.process})"
            ) from None
    return None


def _require_home(folder: Path, attached: msg.Attached) -> None:
    """Raise `AircraftError` if a vehicle that returns without us is not home yet."""
    fates = [f"vehicle {n}: {fate}" for n, fate in sorted(attached.fates.items()) if fate]
    if fates:
        brought = f"interrupted; {attached.reason} without this command, see {folder / RECORD}"
        raise AircraftError("\n".join([brought, *fates])) from None


def _keep_record(folder: Path, journal: Journal) -> None:
    events: list[Event] = []
    # the last message that the mission had is recorded as well: it may not have kept it
    kept = set(journal.bodies())
    for message in recorded(folder):
        if isinstance(message, msg.EventReport):
            if to_json(message.event) not in kept:
                events.append(message.event)
        elif isinstance(message, msg.Line):
            _LOG.info(f"meanwhile: {message.text}")
    journal.append_all(events)
    (folder / RECORD).unlink(missing_ok=True)


def recorded(folder: Path) -> list[msg.Message]:
    """Return the messages of the aircraft without a mission; a truncated last one is left out."""
    decoder, found = msg.Decoder(), list[msg.Message]()
    with contextlib.suppress(OSError, LinkError):
        found.extend(decoder.feed((folder / RECORD).read_bytes()))
    return found
