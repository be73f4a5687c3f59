"""uavmap keys: make a signing key, install it on a vehicle, or remove it."""

from __future__ import annotations

import argparse
import asyncio
import sys
from functools import partial
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from uavmap.base.clock import ScaledClock
from uavmap.base.clock import run as run_on
from uavmap.mavlink.links.signing import Signing, new_key, read_key, signing_with
from uavmap.mavlink.links.transports import Transport, open_transport
from uavmap.mavlink.links.urls import parse_url
from uavmap.mavlink.session import Session
from uavmap.ui.cli.common import confirm

ANSWER_S: Final = 10.0
PROOF_S: Final = 6.0
"""Maximum time until a vehicle with the key sends a signed message, s."""
_TIMES: Final = 3
"""Number of times that the key is sent, since vehicles do not acknowledge it."""
EXAMPLES: Final = """\
  uavmap keys new ~/.uavmap.key
  uavmap keys install ~/.uavmap.key --connect serial:///dev/ttyACM0:115200
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --key ~/.uavmap.key
  uavmap keys remove ~/.uavmap.key --connect serial:///dev/ttyACM0:115200
"""
NOTES: Final = """\
The link carries the key in clear text: install it by cable. From then on ArduPilot signs all its
messages, and accepts only signed ones. Its first serial port (USB) still accepts all messages: you
can replace a lost key there. A ground station needs the key as well.

exit codes:
  0    done
  2    refused, or no proof that it was done
"""
DESCRIPTION: Final = (
    "Set up MAVLink 2 signing: a vehicle then obeys only messages signed with its key."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    acts = parser.add_subparsers(dest="act", required=True, metavar="ACT")
    new = acts.add_parser("new", help="make a key in a new file that only you can read")
    new.add_argument("file", metavar="FILE", help="the new file")
    for name, text in (
        ("install", "install the key on a disarmed vehicle, and check that it signs with it"),
        ("remove", "remove the key from a disarmed vehicle, which then stops signing"),
    ):
        act = acts.add_parser(name, help=text)
        act.add_argument("file", metavar="FILE", help="the file of the key")
        act.add_argument("--connect", metavar="URL", required=True, help="the URL of the vehicle")
        act.add_argument("--yes", action="store_true", help="do it without a question")


def run(options: argparse.Namespace) -> int:
    """Make a key, or change the key of a vehicle."""
    path = Path(options.file).expanduser()
    if options.act == "new":
        new_key(path)
        print(f"{path}: a new key that only you can read; keep a copy of it in a safe place")
    else:
        read_key(path)
        run_on(_set_up(options, path, install=options.act == "install"), ScaledClock(1.0))
    return 0


async def _set_up(options: argparse.Namespace, path: Path, *, install: bool) -> None:
    opened: list[Transport] = []
    # no frame of this link is recorded: one contains the key

    def send(frame: bytes) -> None:
        for transport in opened:
            transport.send(frame)

    session, show = Session(send, lambda frame: None), partial(print, file=sys.stderr)
    endpoint = parse_url(options.connect)
    session.view.wanted_system = endpoint.system
    with signing_with(str(path)) as signing:
        assert signing is not None
        async with open_transport(endpoint, session.feed, show) as transport:
            opened.append(transport)
            await _require_disarmed(session, endpoint.url)
            question = _INSTALL_QUESTION if install else _REMOVE_QUESTION
            name = f"system {session.view.system_id} ({session.view.kind.name})"
            if not options.yes and not await asyncio.to_thread(
                _confirm, question.format(name=name)
            ):
                raise LinkError("no key was changed")
            await _require_disarmed(session, endpoint.url)
            await (install_key if install else remove_key)(session, signing, endpoint.url)
    print(f"{name}: {'has the key, and signs with it' if install else 'signs no longer'}")


_INSTALL_QUESTION: Final = (
    "Install the key on {name}? It will keep the key, and accept only messages that are signed "
    "with it. Each ground station then needs the key."
)
_REMOVE_QUESTION: Final = (
    "Remove the key from {name}? It will then obey each sender that reaches it."
)


async def _require_disarmed(session: Session, url: str) -> None:
    """Wait for a new message of the vehicle. Raises `LinkError` if it is armed or silent."""
    begin_s = asyncio.get_running_loop().time()
    while True:
        session.heartbeat()  # some vehicles only answer
        if await session.until(lambda: session.view.received_s > begin_s, 1.0):
            break
        if asyncio.get_running_loop().time() - begin_s > ANSWER_S:
            raise LinkError(f"{url}: no vehicle answered within {ANSWER_S:g} s")
    if session.view.armed:
        raise LinkError(f"{url}: the vehicle is armed; disarm it before you change its key")


async def install_key(session: Session, signing: Signing, url: str) -> None:
    """Install the key on the vehicle. Raises `LinkError` if it does not sign with it then."""
    view = session.view
    for _ in range(_TIMES):
        session.send(signing.set_up(view.system_id, view.autopilot_component))
    session.signing = signing
    begin_s = asyncio.get_running_loop().time()
    if not await session.until(lambda: view.received_s > begin_s, PROOF_S):
        raise LinkError(
            f"{url}: no message of the vehicle is signed with this key; it cannot sign, or has "
            "another key already (ArduPilot accepts a new one by USB)"
        )


async def remove_key(session: Session, signing: Signing, url: str) -> None:
    """End signing on the vehicle that has the key. Raises `LinkError` if it still signs."""
    view = session.view
    signed: list[bool] = []
    session.signing = signing
    for _ in range(_TIMES):
        session.send(signing.removal(view.system_id, view.autopilot_component))
    session.signing = None

    def note(message: Any) -> None:
        # a camera beside the autopilot never signs: only messages of the autopilot are proof
        if message.get_srcComponent() == view.autopilot_component:
            signed.append(bool(message.get_header().incompat_flags & mav.MAVLINK_IFLAG_SIGNED))

    session.listen(note, "HEARTBEAT")
    if not await session.until(lambda: False in signed, PROOF_S):
        raise LinkError(f"{url}: the vehicle still signs; give the key that it has")


def _confirm(question: str) -> bool:
    if not sys.stdin.isatty():
        raise LinkError("the question before the change needs a terminal; give --yes")
    return confirm(question)
