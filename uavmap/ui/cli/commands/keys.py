"""uavmap keys: make a signing key, give it to a vehicle, take it back."""

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
from uavmap.ui.cli.common import agreed

ANSWER_S: Final = 10.0
PROOF_S: Final = 6.0
"""Maximum time until a vehicle with the key sends something signed, s."""
_TIMES: Final = 3
"""Number of times that the key is sent: it is not acknowledged."""
EXAMPLES: Final = """\
examples:
  uavmap keys new ~/.uavmap.key
  uavmap keys install ~/.uavmap.key --connect serial:///dev/ttyACM0:115200
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --key ~/.uavmap.key
  uavmap keys remove ~/.uavmap.key --connect serial:///dev/ttyACM0:115200

The key goes over the link as it is: install it by a cable, or where nobody listens. An ArduPilot
keeps it, signs all that it sends from then on, and hears only what is signed with it; by its first
serial port (USB) it hears everything still, so a lost key can be replaced there. A ground station
needs the key, too. exit codes: 0 done; 2 refused, or no proof that it was done.
"""
DESCRIPTION: Final = "MAVLink 2 signing: only who has the key is heard."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    acts = parser.add_subparsers(dest="act", required=True, metavar="ACT")
    made = acts.add_parser("new", help="make a key in a new file that only you may read")
    made.add_argument("file", metavar="FILE")
    for name, words in (
        ("install", "give a disarmed vehicle the key, and see that it signs with it"),
        ("remove", "have a disarmed vehicle that has the key forget it, and sign no more"),
    ):
        act = acts.add_parser(name, help=words)
        act.add_argument("file", metavar="FILE", help="the file of the key")
        act.add_argument("--connect", metavar="URL", required=True, help="where it is reached")
        act.add_argument("--yes", action="store_true", help="do it without asking")


def run(options: argparse.Namespace) -> int:
    """Make a key, or change that of a vehicle."""
    path = Path(options.file).expanduser()
    if options.act == "new":
        new_key(path)
        print(f"{path}: a new key, for you only; keep a copy of it where nobody else can read it")
    else:
        read_key(path)
        run_on(_set_up(options, path, install=options.act == "install"), ScaledClock(1.0))
    return 0


async def _set_up(options: argparse.Namespace, path: Path, *, install: bool) -> None:
    opened: list[Transport] = []
    # nothing of this is recorded: a frame of it holds the key

    def send(frame: bytes) -> None:
        for transport in opened:
            transport.send(frame)

    session, say = Session(send, lambda frame: None), partial(print, file=sys.stderr)
    endpoint = parse_url(options.connect)
    session.view.wanted_system = endpoint.system
    with signing_with(str(path)) as signing:
        assert signing is not None
        async with open_transport(endpoint, session.feed, say) as transport:
            opened.append(transport)
            await _disarmed(session, endpoint.url)
            what = _WHAT_INSTALL if install else _WHAT_REMOVE
            name = f"system {session.view.system_id} ({session.view.kind.name})"
            if not options.yes and not await asyncio.to_thread(_asked, what.format(name=name)):
                raise LinkError("nothing was changed")
            await _disarmed(session, endpoint.url)
            await (give_key if install else remove_key)(session, signing, endpoint.url)
    print(f"{name}: {'has the key, and signs with it' if install else 'signs no more'}")


_WHAT_INSTALL: Final = (
    "{name} will be given this key, and keep it. From then on it hears only what is signed with "
    "it: every ground station needs the key, too. Go on?"
)
_WHAT_REMOVE: Final = "{name} will forget its key. From then on it obeys whoever reaches it. Go on?"


async def _disarmed(session: Session, url: str) -> None:
    """Wait for a new message of the vehicle. Raises `LinkError` where it is armed, or silent."""
    begin_s = asyncio.get_running_loop().time()
    while True:
        session.heartbeat()  # some vehicles only answer
        if await session.until(lambda: session.view.heard_s > begin_s, 1.0):
            break
        if asyncio.get_running_loop().time() - begin_s > ANSWER_S:
            raise LinkError(f"{url}: no vehicle answered within {ANSWER_S:g} s")
    if session.view.armed:
        raise LinkError(f"{url}: the vehicle is armed; a key is changed on a disarmed one only")


async def give_key(session: Session, signing: Signing, url: str) -> None:
    """Give the vehicle the key. Raises `LinkError` where it does not sign with it then."""
    view = session.view
    for _ in range(_TIMES):
        session.send(signing.set_up(view.system_id, view.autopilot_component))
    session.signing = signing
    begin_s = asyncio.get_running_loop().time()
    if not await session.until(lambda: view.heard_s > begin_s, PROOF_S):
        raise LinkError(
            f"{url}: the vehicle has said nothing that is signed with this key; it may not sign at "
            "all, or have another key already (an ArduPilot takes a new one by USB)"
        )


async def remove_key(session: Session, signing: Signing, url: str) -> None:
    """End signing on the vehicle that has the key. Raises `LinkError` where it goes on signing."""
    view = session.view
    signed: list[bool] = []
    session.signing = signing
    for _ in range(_TIMES):
        session.send(signing.removal(view.system_id, view.autopilot_component))
    session.signing = None

    def hear(message: Any) -> None:
        # a camera beside the autopilot never signs: only the autopilot's word is proof
        if message.get_srcComponent() == view.autopilot_component:
            signed.append(bool(message.get_header().incompat_flags & mav.MAVLINK_IFLAG_SIGNED))

    session.listen(hear, "HEARTBEAT")
    if not await session.until(lambda: False in signed, PROOF_S):
        raise LinkError(f"{url}: the vehicle goes on signing; is this the key that it has?")


def _asked(question: str) -> bool:
    if not sys.stdin.isatty():
        raise LinkError("nobody is there to be asked; give --yes")
    return agreed(question)
