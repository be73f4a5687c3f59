"""The command `uavmap`.

Exit codes: 0 complete; 2 wrong input or link, with a line; 3 the flight is over, the mission
incomplete; 4 an aircraft is down, or was left to its autopilot, even if the map is complete; 130
interrupted; 141 the output has no reader any more, and no aircraft depends on it.
"""

from __future__ import annotations

import argparse
import contextlib
import difflib
import errno
import gc
import select
import sys
from collections.abc import Sequence
from importlib import import_module
from io import TextIOWrapper
from typing import Any, Final

from missions.errors import AircraftError, OutputError, UavmapError, leaves
from uavmap.base.version import __version__

USER_ERROR: Final = 2
INCOMPLETE: Final = 3
AIRCRAFT_DOWN: Final = 4
NO_VERDICT: Final = 5
INTERRUPTED: Final = 130
NOBODY_READS: Final = 141
"""The code of a program that a closed pipe has ended."""
_COLLECT_EVERY: Final = 10_000
"""Objects between two garbage collections: a flight creates many that live, and few cycles."""
COMMANDS: Final = {
    "app": "plan, practise, fly and hand on maps in a browser",
    "new": "make a mission from an area drawn elsewhere",
    "fly": "fly a mission, simulated or real",
    "onboard": "fly one vehicle of a fleet, from its own computer",
    "merge": "make one map of the journals of a fleet, or of several flights",
    "resume": "go on with an interrupted mission",
    "watch": "show a flight in a browser, live or from its journal",
    "doctor": "look at the installation, at a vehicle, and whether it could fly a mission",
    "sitl": "simulated vehicles on sockets, for any MAVLink client",
    "replay": "map what recorded pictures show",
    "look": "see what the detector says of one picture",
    "tune": "learn a detector from a few painted pictures",
    "animate": "show a flown mission as an animation, and its tree as a picture",
    "check": "check a mission file and say what would be flown",
    "report": "write the report of a flight: one page, to read and to print",
    "export": "write a mission for a ground station, or a map for a GIS",
    "tiles": "keep the tiles of an online map around an area, for the field",
    "keys": "signing keys: make one, give it to a vehicle, take it back",
    "simulate": "compare strategies on ROIs, without flying",
    "strategies": "list the strategies: what each promises, and when to use it",
    "completion": "print what a shell needs to complete commands and options",
    "study": "repeat a study of the papers: table, plot, page",
}
"""Each has a module of its name with `DESCRIPTION`, `EXAMPLES`, `add_arguments` and `run`, imported
when it is asked for: all together take a second."""
OF_THE_LAB: Final = ("simulate", "study")
"""The commands whose modules are in `uavmap.lab.commands`."""


def _module_of(command: str) -> Any:
    import_module("missions.lab.strategies")  # these register themselves, for all commands
    import_module("uavmap.load.strategy_source").load_strategies()
    package = "uavmap.lab.commands" if command in OF_THE_LAB else "uavmap.ui.cli.commands"
    return import_module(f"{package}.{command}")


def parser(wanted: str | None = None) -> argparse.ArgumentParser:
    """Create the command line, with the options of one command, or of all."""
    top = argparse.ArgumentParser(
        prog="uavmap",
        description="Map a region of unknown shape with one or more multicopters.",
        epilog="Start with: uavmap fly runway --sim; for a place of yours: uavmap new --help",
    )
    top.add_argument("--version", action="version", version=f"uavmap {__version__}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, line in COMMANDS.items():
        command = commands.add_parser(
            name, help=line, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        if wanted in (None, name):
            module = _module_of(name)
            command.description, command.epilog = module.DESCRIPTION, module.EXAMPLES
            module.add_arguments(command)
    return top


def _parsed(arguments: Sequence[str]) -> argparse.Namespace | None:
    """Parse the options; None without any, where the help is shown."""
    wanted = next((word for word in arguments if not word.startswith("-")), "")
    top = parser(wanted)
    if not arguments:
        top.print_help()
        return None
    if wanted and wanted not in COMMANDS:
        near = difflib.get_close_matches(wanted, COMMANDS, n=1)
        meant = f"did you mean {near[0]}?" if near else "uavmap --help lists them"
        top.error(f"there is no command {wanted!r}: {meant}")
    return top.parse_args(arguments)


def complain(line: str) -> None:
    """Print a line on standard error, if it is still read."""
    with contextlib.suppress(OSError):
        print(f"uavmap: {line}", file=sys.stderr)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return the exit code."""
    options = _parsed(sys.argv[1:] if arguments is None else arguments)
    gc.freeze()  # what is loaded stays: the collector need not search it again and again
    gc.set_threshold(_COLLECT_EVERY)
    gc.enable()
    if options is None:
        return USER_ERROR
    if isinstance(sys.stdout, TextIOWrapper):
        # a file's name may be no text: it is shown in escapes
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.reconfigure(errors="backslashreplace")
    try:
        code = _run(options)
    except* AircraftError as group:
        _say(group)
        code = AIRCRAFT_DOWN
    except* UavmapError as group:
        _say(group)
        code = USER_ERROR
    except* MemoryError as group:
        code = _out_of_memory(group)
    except* BrokenPipeError:  # `uavmap check field.toml | head` has read enough
        if _is_read():
            raise
        code = NOBODY_READS
    except* KeyboardInterrupt:
        complain("interrupted")
        code = INTERRUPTED
    return code


def _is_read() -> bool:
    """Return whether the output still has a reader."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
            watched = select.poll()
            watched.register(stream, 0)
        except BrokenPipeError:
            return False
        except (OSError, ValueError):  # no file, or one that cannot be watched
            continue
        if any(what & select.POLLERR for _, what in watched.poll(0)):
            return False
    return True


def _say(group: BaseExceptionGroup[UavmapError]) -> None:
    for error in leaves(group):
        for line in str(error).splitlines():  # a mission file may have several faults
            complain(line)


def _notes(error: BaseException) -> list[str]:
    found = list(getattr(error, "__notes__", ()))
    if isinstance(error, BaseExceptionGroup):
        found += [note for inner in error.exceptions for note in _notes(inner)]
    return found


def _out_of_memory(group: BaseExceptionGroup[MemoryError]) -> int:
    """Complain, and show where aircraft are that were flown meanwhile."""
    complain(
        "the memory of this computer does not suffice: close other programs, or ask for less "
        "(a smaller region or picture, fewer workers); of a flight nothing is lost that is in its "
        "journal, and `uavmap resume DIR` goes on with it"
    )
    fates = _notes(group)
    for fate in fates:
        complain(fate)
    return AIRCRAFT_DOWN if fates else USER_ERROR


def _run(options: argparse.Namespace) -> int:
    try:
        code: int = _module_of(options.command).run(options)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EIO) and error.filename is None:
            what = error.strerror or "it is refused"
            raise OutputError(f"the output, or a file, cannot be written: {what}") from None
        if error.errno != errno.ENAMETOOLONG:
            raise
        name = str(error.filename or "an argument")
        raise UavmapError(f"{name[:60]}...: too long for the name of a file") from None
    return code
