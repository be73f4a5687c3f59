"""What MAVSDK may send over the link: what it was asked for just now, and nothing else.

The library repeats a command until it is answered, and some of its plug-ins do more than they are
called for: they change the mode first, or a rate. A pilot who has taken the aircraft must not lose
it to a repetition, so each frame is looked at on its way out.
"""

from __future__ import annotations

import contextlib
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from uavmap.mavlink.session import Permit

Message = Any

_COMMANDS: Final = ("COMMAND_LONG", "COMMAND_INT")
_QUESTIONS: Final = (mav.MAV_CMD_REQUEST_MESSAGE,)
"""Commands that MAVSDK may send when it likes: it asks what a vehicle is."""

Kind = tuple[int, int]
"""The id of a message, and of the command in it, -1 where there is none."""


def kind_of(message: Message) -> Kind:
    """What a message is, for the question whether it may go.

    >>> kind_of(mav.MAVLink_command_ack_message(400, 0))
    (77, -1)
    """
    command = message.command if message.get_type() in _COMMANDS else -1
    return message.get_msgId(), command


class Outbox:
    """Lets pass what was asked for; `send` takes the frames."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._codec = mav.MAVLink(None)
        self._codec.robust_parsing = True
        self._asked: defaultdict[int, list[Permit | None]] = defaultdict(list)
        """Commands that are waited for just now, each with its permit."""
        self._once: Counter[Kind] = Counter()
        """Single messages that were handed to MAVSDK and have not come out yet."""
        self.held_back: Counter[str] = Counter()
        """What did not pass, by its kind."""

    @contextlib.contextmanager
    def asked(self, command: int, permit: Permit | None = None) -> Iterator[None]:
        """While it lasts a command may go as often as MAVSDK likes and `permit` grants."""
        self._asked[command].append(permit)
        try:
            yield
        finally:
            self._asked[command].remove(permit)

    def once(self, message: Message) -> None:
        """A message may go."""
        self._once[kind_of(message)] += 1

    def not_sent(self, message: Message) -> None:
        """One that might go has not come out, as far as is known, and may not any more."""
        kind = kind_of(message)
        self._once[kind] = max(self._once[kind] - 1, 0)

    def take(self, data: bytes) -> None:
        """What MAVSDK wants to be sent."""
        for message in self._codec.parse_buffer(data) or ():
            if message.get_type() == "BAD_DATA":
                continue
            if self._may_go(message):
                self._send(bytes(message.get_msgbuf()))
            else:
                self.held_back[message.get_type()] += 1

    def _may_go(self, message: Message) -> bool:
        kind = kind_of(message)
        if self._once[kind] > 0:
            self._once[kind] -= 1
            return True
        if kind[1] in _QUESTIONS:
            return True
        return any(permit is None or permit.grants() for permit in self._asked[kind[1]])
