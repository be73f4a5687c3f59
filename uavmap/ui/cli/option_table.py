"""All options of the commands that fly, and of the commands that share options with them.

The table is the source of the parsers' options, `FlightOptions` (`field`), the parameters of
`uavmap.fly` and `uavmap.resume` (`python`), and docs/reference/options.md.
`python -m uavmap.ui.cli.option_table` prints that page.
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
"""Commands for which `uavmap` has functions of the same names."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """One option, or one positional argument (a `name` without dashes).

    Attributes:
        also: The help in commands for which it differs from `help`, by command.
        metavar: The name of its value; without it and `choices` the option is a switch.
        const: Its value if it is given without one.
        group: Options of one group exclude each other.
        field: Its name in `FlightOptions`.
        python: True if `uavmap.fly` or `uavmap.resume` has a parameter of its name.
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
        """Return its help in a command."""
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
        help=f"a mission file or a shipped mission: {', '.join(shipped_missions())}",
    ),
    Option(
        name="workspace", metavar="FOLDER", commands=("app",), const=".", default=".",
        help="the folder of missions, photographs and results (default: the current one)",
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
        help="the URL of a vehicle; repeat it for each vehicle (default: the URLs of the mission "
        "file)",
        also={
            "onboard": "the URL of the autopilot (default: the URL in the mission file)",
            "resume": "the URL of a vehicle, if it has changed; repeat it for each vehicle",
            "doctor": "the URL of a vehicle; repeat it for each vehicle",
        },
    ),
    Option(
        name="--fleet", commands=("fly",), group="where",
        help="fly no vehicle, but join a fleet whose vehicles each run `uavmap onboard`. This "
        "computer shows the map and sends orders from keys and page to all vehicles",
    ),
    Option(
        name="--vehicle", metavar="K", type=vehicle_count, required=True,
        commands=("onboard",), field="member",
        help="the number of this vehicle in the mission file, counted from 1",
    ),
    Option(
        name="--listen", metavar="EP", several=True, commands=_LINKED,
        help="the endpoint of this vehicle for the others, such as tcp/0.0.0.0:7447, or the "
        "multicast group of the fleet: udp/224.0.0.224:7447#iface=wlan0; may be repeated",
    ),
    Option(
        name="--peer", metavar="EP", several=True, commands=_LINKED,
        help="the endpoint of another vehicle, such as tcp/192.168.7.12:7447; may be repeated",
    ),
    Option(
        name="--router", metavar="EP", several=True, commands=_LINKED,
        help="the endpoint of a Zenoh router between the vehicles, such as tcp/192.168.7.1:7447; "
        "may be repeated: the first router that answers is used",
    ),
    Option(
        name="--fleet-key", metavar="FILE", commands=_LINKED,
        help="the key of the fleet: messages without it are refused (default: the file that "
        f"{FLEET_KEY_VARIABLE} names). `uavmap keys new FILE` makes one. It is not the key of "
        "--key, which signs MAVLink",
    ),
    Option(
        name="--camera", metavar="SPEC", several=True, commands=(*_LINKED, "doctor"),
        field="cameras", python=True,
        help=f"the camera of a vehicle, in the order of --connect: {CAMERAS}. Default: the camera "
        "of the mission file, else mavlink",
        also={
            "onboard": f"the camera of this vehicle: {CAMERAS}. Default: the camera of the mission "
            "file, else mavlink",
            "resume": f"the camera of a vehicle, if it has changed: {CAMERAS}",
        },
    ),
    Option(
        name="--vehicles", metavar="N", type=vehicle_count,
        commands=("fly",), field="vehicles", python=True,
        help="the number of vehicles (default: as many as the mission file or --connect gives)",
    ),
    Option(
        name="--seed", metavar="S", type=seed_number, default=1,
        commands=("fly", "tune"), field="seed", python=True,
        help="the seed of the simulation: the same seed gives the same flight (default 1)",
        also={"tune": "the seed of the samples (default 0)"},
    ),
    Option(
        name="--comms", metavar="HOW", commands=("fly",), field="comms",
        help="with --sim: run a service on each aircraft, linked by a simulated radio: free, "
        "range:METRES or meeting (within 20 m). Append with commas: loss:0.1, delay:SECONDS, "
        "jitter:SECONDS, rate:BYTES_A_SECOND. Default: one service for all aircraft",
    ),
    Option(
        name="--onboard", commands=("fly",), field="onboard", python=True,
        help="run as a companion computer on the vehicle: a PX4 does not count this service as its "
        "ground station. So its failsafe for a lost ground station needs another one",
    ),
    Option(
        name="--strategy", metavar="NAME", commands=_FLIES, field="strategy", python=True,
        help=f"the strategy, instead of the mission file's: {', '.join(FLOWN)}",
        also={
            "onboard": "the strategy, instead of the mission file's: "
            + ", ".join(fleet_checks.STRATEGIES)
        },
    ),
    Option(
        name="--all-strategies", commands=("fly",), field="all_strategies", python=True,
        help="with --sim: allow also the strategies for comparisons with papers (see `uavmap "
        "strategies`)",
    ),
    Option(
        name="--speedup", metavar="X", type=speedup,
        commands=(*_FLIES, "doctor"), field="speedup", python=True,
        help="the speed, as a multiple of real time (default: with --sim as fast as possible, with "
        "--connect 1)",
        also={
            "onboard": "the speed of a simulator, as a multiple of real time (default 1)",
            "doctor": "the speed of a simulator, as a multiple of real time (default 1)",
        },
    ),
    Option(
        name="--auto-swap", commands=_FLIES, field="auto_swap", python=True,
        help="take off again with a fresh battery without a question; only for simulators (the "
        "bundled one is recognised)",
    ),
    Option(
        name="--driver", choices=DRIVERS, default=PYMAVLINK, commands=_FLIES, field="driver",
        python=True,
        help="the implementation of MAVLink for real aircraft: pymavlink (default) or mavsdk; not "
        "with --sim",
        also={"onboard": "the implementation of MAVLink: pymavlink (default) or mavsdk"},
    ),
    Option(
        name="--driver", choices=DRIVERS, commands=("resume",), python=True,
        help="the implementation of MAVLink from now on (default: as before)",
    ),
    Option(
        name="--key", metavar="FILE", commands=(*_LINKED, "doctor"), field="key_file",
        python=True,
        help="sign MAVLink with the key in FILE, and accept only messages that are signed with it "
        f"(default: the file that {KEY_VARIABLE} names). `uavmap keys new FILE` makes one",
    ),
    Option(
        name="--forward", metavar="URL", several=True, commands=_LINKED, field="forward",
        python=True,
        help="pass all MAVLink messages of the vehicles on to this ground station, and its "
        "messages to the vehicles; may be repeated",
    ),
    Option(
        name="--yes", commands=_FLIES, python=True,
        help="take off without a question; a fault of fence, battery or camera still keeps all "
        "vehicles on the ground",
    ),
    Option(
        name="--dry-run", commands=_FLIES, python=True,
        help="check everything, set fences and return heights, restore them, and arm nothing; exit "
        "code 3 if the mission could not be flown",
    ),
    Option(
        name="--keep-fence", commands=_FLIES, python=True,
        help="keep fence, rally points and return heights of the autopilots; a mission that leaves "
        "such a fence is not flown",
    ),
    Option(
        name="--detector", metavar="NAME|DIR", commands=(*_FLIES, "replay", "look"),
        field="detector", python=True,
        help="the detector, instead of the mission file's: a name such as `paved`, a folder made "
        "by `uavmap tune`, or a detector.toml",
    ),
    Option(
        name="--calibration", metavar="FILE", commands=("replay", "look"),
        help="the calibration of the camera by OpenCV (YAML, XML or JSON), instead of the focal "
        "length in the tags",
    ),
    Option(
        name="--keep-frames", commands=_FLIES, python=True,
        help="keep each picture with its pose in the results, for `uavmap replay`",
    ),
    Option(
        name="--from-home", commands=("resume",), python=True,
        help="in a simulation: start at home with full batteries, not where the aircraft were",
    ),
    Option(
        name="--recall", commands=("resume",), python=True,
        help="only return the vehicles that are in the air; none takes off, so none needs its "
        "crew",
    ),
    Option(
        name="--recover", commands=("resume",),
        help="continue from the intact beginning of a damaged journal; a copy of the damaged file "
        "is kept",
    ),
    Option(
        name="--page", metavar="PORT", type=number_type(int, *_PORTS), const=PORT,
        commands=_LINKED,
        help=f"show the flight live in a browser, with buttons, on port {PORT} or PORT (0: any "
        "free port)",
    ),
    Option(
        name="--port", metavar="N", type=number_type(int, *_PORTS), default=PORT,
        commands=("watch", "app"),
        help=f"the port of the page (default {PORT}; 0: any free port)",
    ),
    Option(
        name="--page-host", metavar="ADDRESS", default=LOOPBACK,
        commands=(*_LINKED, "watch", "app"),
        help="the address at which the page is served, 0.0.0.0 for all networks (default: this "
        "computer only). Each browser needs the token in the URL",
    ),
    Option(
        name="--tiles", metavar="FILE", commands=(*_LINKED, "watch", "app"),
        help="show this file beneath the map of the page: MBTiles, PMTiles or GeoTIFF",
    ),
    Option(
        name="--tak", metavar="URL", commands=_LINKED,
        help="send region, unsure ground, aircraft and paths to TAK, as Cursor on Target: "
        "tcp://HOST:8087, tls://HOST:8089 (certificates: docs/how-to/tak.md) or udp://239.2.3.1:6969",
    ),
    Option(
        name="--out", metavar="DIR", commands=(*_FLIES, "replay", "tune"), python=True,
        help="the folder of the results (default: a new one)",
        also={"tune": "the folder of the detector"},
    ),
    Option(
        name="--verbose", commands=(*_LINKED, "replay", "merge", "report"),
        help="print all figures of the summary, with bounds",
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
    yield "These are the options of the commands that fly. Options marked with * are parameters of"
    yield "`uavmap.fly` and `uavmap.resume`, with underscores for dashes: see"
    yield "[Python](../how-to/python.md)."
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
