"""All options of the commands that fly, and of those that share options with them.

The table makes the parsers' options, `FlightOptions` (`field`), the parameters of `uavmap.fly` and
`uavmap.resume` (`python`), and docs/reference/options.md: `python -m uavmap.ui.cli.option_table`.
"""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from missions.mission import fleet_checks
from missions.mission.checks import FLOWN
from uavmap.aircraft.cameras.spec import HELP as CAMERAS
from uavmap.journal.flight_plan import DRIVERS, KEY_VARIABLE, PYMAVLINK
from uavmap.load.mission_source import shipped_missions
from uavmap.ui.cli.common import number_type, seed_number, speedup, vehicle_count
from uavmap.ui.page.feed import LOOPBACK, PORT

FLEET_KEY_VARIABLE: Final = "UAVMAP_FLEET_KEY_FILE"
_PORTS: Final = (0, 65535)
_FLIES: Final = ("fly", "onboard")
_LINKED: Final = ("fly", "onboard", "resume")
IN_PYTHON: Final = ("fly", "resume")
"""Commands that Python has as functions of their names."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """One option, or one positional argument (a `name` without dashes).

    Attributes:
        also: The help of a command that differs from `help`, by command.
        metavar: The name of its value; without it and `choices` a switch.
        const: Its value where it is given without one.
        group: Options of one group exclude each other.
        field: Its name in `FlightOptions`.
        python: Whether `uavmap.fly` or `uavmap.resume` has a parameter of its name.
    """

    name: str
    help: str
    commands: Sequence[str]
    also: Mapping[str, str] | None = None
    metavar: str | None = None
    type: Callable[[str], Any] = str
    default: Any = None
    several: bool = False
    choices: Sequence[str] | None = None
    const: Any = None
    required: bool = False
    group: str | None = None
    field: str | None = None
    python: bool = False

    @property
    def destination(self) -> str:
        """Its name in a namespace and in Python."""
        return self.name.removeprefix("--").replace("-", "_")

    def help_of(self, command: str) -> str:
        """What it does in a command."""
        return (self.also or {}).get(command, self.help)

    def add_to(self, parser: argparse._ActionsContainer, command: str) -> None:
        """Add it to the parser of a command."""
        how: dict[str, Any] = {"help": self.help_of(command)}
        if self.metavar is None and self.choices is None:
            parser.add_argument(self.name, action="store_true", **how)
            return
        how |= {"metavar": self.metavar, "type": self.type, "default": self.default}
        if self.several:
            how["action"] = "append"
        if self.choices is not None:
            how["choices"] = self.choices
        if self.const is not None:
            how |= {"nargs": "?", "const": self.const}
        if self.required:
            how["required"] = True
        parser.add_argument(self.name, **how)


TABLE: Final = (
    Option(
        name="mission", metavar="MISSION", commands=(*_FLIES, "check"), field="mission_source",
        python=True,
        help=f"a mission file, or a shipped mission: {', '.join(shipped_missions())}",
    ),
    Option(
        name="workspace", metavar="FOLDER", commands=("app",), const=".", default=".",
        help="the folder of missions, photographs and results (default: this one)",
    ),
    Option(
        name="folder", metavar="DIR", commands=("resume", "watch", "report", "animate"),
        help="the results folder of the mission",
    ),
    Option(
        name="--sim", commands=("fly",), group="where", field="simulated", python=True,
        help="simulate the aircraft in this process, on virtual time",
    ),
    Option(
        name="--connect", metavar="URL", several=True, commands=(*_LINKED, "doctor"),
        group="where", field="urls", python=True,
        help="the URL of a vehicle; once a vehicle (default: the URLs of the mission file)",
        also={
            "onboard": "the URL of its autopilot (default: its url in the mission file)",
            "resume": "the URL of a vehicle, if it has changed; once a vehicle",
            "doctor": "the URL of a vehicle; once a vehicle",
        },
    ),
    Option(
        name="--fleet", commands=("fly",), group="where",
        help="fly no vehicle, and join a fleet whose vehicles each run `uavmap onboard`: this "
        "computer shows the map and sends orders of keys and page to all of them",
    ),
    Option(
        name="--vehicle", metavar="K", type=vehicle_count, required=True,
        commands=("onboard",), field="member",
        help="the number of this vehicle in the mission file, from 1",
    ),
    Option(
        name="--listen", metavar="EP", several=True, commands=_LINKED,
        help="the endpoint at which the other vehicles reach this one: tcp/0.0.0.0:7447, or the "
        "multicast group of all, udp/224.0.0.224:7447#iface=wlan0; may be repeated",
    ),
    Option(
        name="--peer", metavar="EP", several=True, commands=_LINKED,
        help="the endpoint of another vehicle: tcp/192.168.7.12:7447; may be repeated",
    ),
    Option(
        name="--router", metavar="EP", several=True, commands=_LINKED,
        help="the endpoint of a Zenoh router between the vehicles: tcp/192.168.7.1:7447; of "
        "several the first that answers",
    ),
    Option(
        name="--fleet-key", metavar="FILE", commands=_LINKED,
        help="the fleet's key, the same for all its vehicles: a message without it is refused "
        f"(default: the file that {FLEET_KEY_VARIABLE} names; `uavmap keys new FILE` makes one). "
        "--key is another key: it signs MAVLink with one's own autopilot",
    ),
    Option(
        name="--camera", metavar="SPEC", several=True, commands=(*_LINKED, "doctor"),
        field="cameras", python=True,
        help=f"the camera of a vehicle, once a vehicle, in the order of --connect: {CAMERAS} "
        "(default: as the mission file says, else mavlink)",
        also={
            "onboard": f"the camera of this vehicle: {CAMERAS} (default: as the mission file "
            "says, else mavlink)",
            "resume": f"the camera of a vehicle, if it has changed; once a vehicle: {CAMERAS}",
        },
    ),
    Option(
        name="--vehicles", metavar="N", type=vehicle_count,
        commands=("fly",), field="vehicles", python=True,
        help="fly with this number of vehicles (default: as many as the mission file, or the "
        "URLs, say)",
    ),
    Option(
        name="--seed", metavar="S", type=seed_number, default=1,
        commands=("fly", "tune"), field="seed", python=True,
        help="the seed of the simulation: the same seed gives the same flight (default 1)",
        also={"tune": "the seed of the samples (default 0)"},
    ),
    Option(
        name="--comms", metavar="HOW", commands=("fly",), field="comms",
        help="with --sim: a service on each aircraft, linked by a simulated radio: free, "
        "range:METRES, or meeting (within 20 m); more after commas: loss:0.1, delay:SECONDS, "
        "jitter:SECONDS, rate:BYTES_A_SECOND (default: one service for all)",
    ),
    Option(
        name="--onboard", commands=("fly",), field="onboard", python=True,
        help="the service flies with the vehicle: a PX4 does not take it for its ground station, "
        "so its failsafe for a lost ground station depends on another one",
    ),
    Option(
        name="--strategy", metavar="NAME", commands=_FLIES, field="strategy", python=True,
        help=f"instead of the mission file's: {', '.join(FLOWN)}",
        also={
            "onboard": f"instead of the mission file's: {', '.join(fleet_checks.STRATEGIES)}"
        },
    ),
    Option(
        name="--all-strategies", commands=("fly",), field="all_strategies", python=True,
        help="with --sim: strategies that serve comparisons in papers may fly, too "
        "(`uavmap strategies`)",
    ),
    Option(
        name="--speedup", metavar="X", type=speedup,
        commands=(*_FLIES, "doctor"), field="speedup", python=True,
        help="times real time (default: with --sim as fast as possible, with --connect 1)",
        also={
            "onboard": "times real time, for simulators (default 1)",
            "doctor": "times real time, of a simulator (default 1)",
        },
    ),
    Option(
        name="--auto-swap", commands=_FLIES, field="auto_swap", python=True,
        help="take off again as soon as a battery is fresh, without a question; only for "
        "simulators (the bundled one is recognised)",
    ),
    Option(
        name="--driver", choices=DRIVERS, default=PYMAVLINK, commands=_FLIES, field="driver",
        python=True,
        help="what speaks MAVLink with real aircraft: this program with pymavlink's codec "
        "(default), or MAVSDK; not with --sim",
        also={
            "onboard": "what speaks MAVLink with the aircraft: this program with pymavlink's "
            "codec (default), or MAVSDK"
        },
    ),
    Option(
        name="--driver", choices=DRIVERS, commands=("resume",), python=True,
        help="what speaks MAVLink from now on (default: as before)",
    ),
    Option(
        name="--key", metavar="FILE", commands=(*_LINKED, "doctor"), field="key_file",
        python=True,
        help="sign what is sent with the key in FILE, and accept only what is signed with it "
        f"(default: the file that {KEY_VARIABLE} names; `uavmap keys new FILE` makes one)",
    ),
    Option(
        name="--forward", metavar="URL", several=True, commands=_LINKED, field="forward",
        python=True,
        help="pass all frames of the vehicles on to a ground station there, and its frames to "
        "them; may be repeated",
    ),
    Option(
        name="--yes", commands=_FLIES, python=True,
        help="take off without a question; a fault of fence, battery or camera keeps all vehicles "
        "on the ground all the same",
    ),
    Option(
        name="--dry-run", commands=_FLIES, python=True,
        help="check everything, set fences and return heights, put them back, and arm nothing; "
        "exit code 3 where the mission could not be flown",
    ),
    Option(
        name="--keep-fence", commands=_FLIES, python=True,
        help="leave fence, rally points and return heights of the autopilots as they are; a "
        "mission that leaves such a fence is not flown",
    ),
    Option(
        name="--detector", metavar="NAME|DIR", commands=(*_FLIES, "replay", "look"),
        field="detector", python=True,
        help="judge pictures by this detector, not by that of the mission file: a name such as "
        "`paved`, a folder that `uavmap tune` has written, or a detector.toml",
    ),
    Option(
        name="--calibration", metavar="FILE", commands=("replay", "look"),
        help="the camera's calibration by OpenCV: YAML, XML or JSON; instead of the tags' focal "
        "length",
    ),
    Option(
        name="--keep-frames", commands=_FLIES, python=True,
        help="keep every picture with its pose in the results, for `uavmap replay`",
    ),
    Option(
        name="--from-home", commands=("resume",), python=True,
        help="simulation: put the aircraft at home with full batteries instead of where they were",
    ),
    Option(
        name="--recall", commands=("resume",), python=True,
        help="only bring home the vehicles in the air; no vehicle takes off, so none needs a "
        "person beside it",
    ),
    Option(
        name="--recover", commands=("resume",),
        help="go on from the good beginning of a damaged journal; the damaged file is kept aside",
    ),
    Option(
        name="--page", metavar="PORT", type=number_type(int, *_PORTS), const=PORT,
        commands=_LINKED,
        help=f"show the flight live in a browser, with buttons; on port {PORT}, or another, 0 for "
        "any that is free",
    ),
    Option(
        name="--port", metavar="N", type=number_type(int, *_PORTS), default=PORT,
        commands=("watch", "app"),
        help=f"serve the page on this port (default {PORT}), 0 for any that is free",
    ),
    Option(
        name="--page-host", metavar="ADDRESS", default=LOOPBACK,
        commands=(*_LINKED, "watch", "app"),
        help="serve the page on this address of the computer, 0.0.0.0 for all (default: only to "
        "this computer itself); the token in its URL is needed in any case",
    ),
    Option(
        name="--tiles", metavar="FILE", commands=(*_LINKED, "watch", "app"),
        help="lay a map of this computer beneath the page's: MBTiles, PMTiles or GeoTIFF",
    ),
    Option(
        name="--tak", metavar="URL", commands=_LINKED,
        help="send region, unsure ground, aircraft and their paths to TAK, as Cursor on Target: "
        "tcp://HOST:8087, tls://HOST:8089 (certificates: docs/how-to/tak.md) or udp://239.2.3.1:6969",
    ),
    Option(
        name="--out", metavar="DIR", commands=(*_FLIES, "replay", "tune"), python=True,
        help="folder for the results (default: a new one)",
        also={"tune": "folder for the detector"},
    ),
    Option(
        name="--verbose", commands=(*_LINKED, "replay", "merge", "report"),
        help="print every figure of the summary, with bounds",
    ),
    Option(
        name="--json", help="print the summary as JSON",
        commands=(*_LINKED, "doctor", "replay", "look", "tune", "merge", "report", "check",
                  "strategies"),
        also={
            "doctor": "print the findings as JSON", "look": "print the figures as JSON",
            "tune": "print the report as JSON", "check": "print the figures as JSON",
            "strategies": "print the list as JSON",
        },
    ),
)  # fmt: skip


def options_of(command: str) -> list[Option]:
    """Return the options of a command, in their order."""
    return [option for option in TABLE if command in option.commands]


def add_options(parser: argparse.ArgumentParser, command: str) -> None:
    """Add the options of a command."""
    groups: dict[str, argparse._MutuallyExclusiveGroup] = {}
    for option in options_of(command):
        target: argparse._ActionsContainer = parser
        if option.group is not None:
            if option.group not in groups:
                groups[option.group] = parser.add_mutually_exclusive_group()
            target = groups[option.group]
        option.add_to(target, command)


def reference() -> str:
    """Return the page of reference, in Markdown."""
    return "\n".join(_page()) + "\n"


def _page() -> Iterator[str]:
    yield "# Options of a flight"
    yield ""
    yield "<!-- made by: python -m uavmap.ui.cli.option_table > docs/reference/options.md -->"
    yield ""
    yield "The options of the commands that fly. `uavmap.fly` and `uavmap.resume` have those marked"
    yield "with * as parameters, with underscores for dashes; see [Python](../how-to/python.md)."
    for command in _LINKED:
        yield ""
        yield f"## `uavmap {command}`"
        yield ""
        for option in options_of(command):
            star = "*" if option.python and command in IN_PYTHON else ""
            value = option.metavar or "|".join(option.choices or ())
            shown = f"[{value}]" if option.const is not None else value
            written = f"{option.name} {shown}".strip() if option.name.startswith("--") else shown
            yield from textwrap.wrap(
                f"- `{written}`{star}: {option.help_of(command)}", 110, subsequent_indent="  ",
                break_long_words=False, break_on_hyphens=False,
            )  # fmt: skip


if __name__ == "__main__":
    print(reference(), end="")
