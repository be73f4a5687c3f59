"""The command `uavmap`.

Exit codes:

* 0: complete.
* 2: wrong input or link; a line names it.
* 3: the flight is over and the mission is not complete.
* 4: an aircraft is down or was left to its autopilot, even if the map is complete.
* 5: the flight is over and the detector does not fit the ground.
* 130: interrupted.
* 141: the output has no reader any more, and no aircraft depends on it.
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
PIPE_CLOSED: Final = 141
"""Exit code of a program that a closed pipe has ended."""
_COLLECT_EVERY: Final = 10_000
"""Number of objects between two garbage collections: a flight creates many that stay."""
COMMANDS: Final = {
    "app": "plan, practise, fly and share maps in a browser",
    "new": "make a mission from an area",
    "fly": "fly a mission, simulated or real",
    "onboard": "fly one vehicle of a fleet from its own computer",
    "merge": "make one map from the journals of a fleet or of several flights",
    "resume": "continue an interrupted mission",
    "watch": "show a flight in a browser, live or from its journal",
    "doctor": "check the installation, a vehicle, and a vehicle for a mission",
    "sitl": "simulate vehicles on sockets for any MAVLink client",
    "replay": "make a map from recorded pictures",
    "look": "show what the detector finds in one picture",
    "tune": "train a detector on a few painted pictures",
    "animate": "make an animation of a flight",
    "check": "check a mission file and show its plan",
    "report": "write the report of a flight, to read and to print",
    "export": "write a mission for a ground station, or a map for a GIS",
    "tiles": "save the tiles of an online map around an area, for the field",
    "keys": "make a signing key, install it on a vehicle, or remove it",
    "simulate": "compare strategies without a flight",
    "strategies": "list the strategies, with their guarantees",
    "completion": "print the script that completes commands in a shell",
    "study": "repeat a study of the papers: table, plot, page",
}
"""Commands with their lines of help, in the order of the help.

Each has a module of its name with `DESCRIPTION`, `EXAMPLES`, `NOTES`, `add_arguments` and `run`. It
is imported on demand: to import all takes a second.
"""
LAB_COMMANDS: Final = ("simulate", "study")
"""Commands whose modules are in `uavmap.lab.commands`."""
EXAMPLES: Final = """\
  uavmap fly runway --sim                      your first flight, simulated
  uavmap new field.kml --drone x500            a mission for your own area
"""


class CommandParser(argparse.ArgumentParser):
    """A parser whose help begins with examples.

    Attributes:
        examples: Lines of examples, indented by two spaces; empty for none.
    """

    examples = ""

    def format_help(self) -> str:
        """Return the help: examples, then usage, description, arguments and notes."""
        return f"examples:\n{self.examples}\n" * bool(self.examples) + super().format_help()


def _module_of(command: str) -> Any:
    import_module("missions.lab.strategies")  # these register themselves, for all commands
    import_module("uavmap.load.strategy_source").load_strategies()
    package = "uavmap.lab.commands" if command in LAB_COMMANDS else "uavmap.ui.cli.commands"
    return import_module(f"{package}.{command}")


def parser(name: str | None = None) -> argparse.ArgumentParser:
    """Create the parser of the command line, with the options of one command, or of all."""
    top = CommandParser(
        prog="uavmap", description="Map a region of unknown shape with one or more multicopters."
    )
    top.examples = EXAMPLES
    top.add_argument("--version", action="version", version=f"uavmap {__version__}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for each, line in COMMANDS.items():
        command = commands.add_parser(
            each, help=line, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        if name in (None, each):
            module = _module_of(each)
            command.examples = module.EXAMPLES
            command.description, command.epilog = module.DESCRIPTION, module.NOTES
            module.add_arguments(command)
    return top


def _parsed(arguments: Sequence[str]) -> argparse.Namespace | None:
    """Parse the options; without any, print the help and return None."""
    name = next((word for word in arguments if not word.startswith("-")), "")
    top = parser(name)
    if not arguments:
        top.print_help()
        return None
    if name and name not in COMMANDS:
        near = difflib.get_close_matches(name, COMMANDS, n=1)
        meant = f"did you mean {near[0]}?" if near else "uavmap --help lists the commands"
        top.error(f"there is no command {name!r}: {meant}")
    return top.parse_args(arguments)


def complain(line: str) -> None:
    """Print a line on standard error, if it still has a reader."""
    with contextlib.suppress(OSError):
        print(f"uavmap: {line}", file=sys.stderr)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return the exit code."""
    options = _parsed(sys.argv[1:] if arguments is None else arguments)
    gc.freeze()  # loaded modules stay: the collector need not search them again and again
    gc.set_threshold(_COLLECT_EVERY)
    gc.enable()
    if options is None:
        return USER_ERROR
    if isinstance(sys.stdout, TextIOWrapper):
        # a file name may be invalid text: it is shown with escapes
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.reconfigure(errors="backslashreplace")
    try:
        code = _run(options)
    except* AircraftError as group:
        _print_errors(group)
        code = AIRCRAFT_DOWN
    except* UavmapError as group:
        _print_errors(group)
        code = USER_ERROR
    except* MemoryError as group:
        code = _out_of_memory(group)
    except* BrokenPipeError:  # `uavmap check field.toml | head` has read enough
        if _has_reader():
            raise
        code = PIPE_CLOSED
    except* KeyboardInterrupt:
        complain("interrupted")
        code = INTERRUPTED
    return code


def _has_reader() -> bool:
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
        if any(state & select.POLLERR for _, state in watched.poll(0)):
            return False
    return True


def _print_errors(group: BaseExceptionGroup[UavmapError]) -> None:
    for error in leaves(group):
        for line in str(error).splitlines():  # a mission file may have several faults
            complain(line)


def _notes(error: BaseException) -> list[str]:
    found = list(getattr(error, "__notes__", ()))
    if isinstance(error, BaseExceptionGroup):
        found += [note for inner in error.exceptions for note in _notes(inner)]
    return found


def _out_of_memory(group: BaseExceptionGroup[MemoryError]) -> int:
    """Print an error, and the places of the aircraft that were in flight."""
    complain(
        "this computer has too little memory: close other programs, or choose a smaller region, "
        "smaller pictures or fewer workers. The journal of a flight is intact: `uavmap resume DIR` "
        "continues it"
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
            reason = error.strerror or "the system refused it"
            raise OutputError(f"the output, or a file, cannot be written: {reason}") from None
        if error.errno != errno.ENAMETOOLONG:
            raise
        name = str(error.filename or "an argument")
        raise UavmapError(f"{name[:60]}...: too long for a file name") from None
    return code
