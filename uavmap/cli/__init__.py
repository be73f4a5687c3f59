"""The command `uavmap`.

Exit codes: 0 done and complete; 2 something is wrong with the input or the link, said in a line;
3 the flight is over, but the mission incomplete; 4 an aircraft is down, or was left to its
autopilot, whether the mission is complete or not; 130 interrupted.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import os
import sys
from collections.abc import Sequence
from io import TextIOWrapper

from missions.errors import AircraftError, UavmapError, leaves
from uavmap import __version__
from uavmap.cli import (
    animate,
    camera,
    check,
    doctor,
    export,
    fly,
    keys,
    look,
    replay,
    resume,
    simulate,
    sitl,
    strategies,
    study,
    tune,
)
from uavmap.cli.common import AIRCRAFT_DOWN, INTERRUPTED, complain

USER_ERROR = 2


def parser() -> argparse.ArgumentParser:
    """The command line."""
    top = argparse.ArgumentParser(
        prog="uavmap",
        description="Map a region of unknown shape with one or more multicopters.",
        epilog="Start with: uavmap fly runway --sim",
    )
    top.add_argument("--version", action="version", version=f"uavmap {__version__}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in (
        fly, resume, doctor, camera, sitl, replay, look, tune, animate, check, export, keys,
        simulate, strategies, study,
    ):  # fmt: skip
        module.add_parser(commands)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code."""
    options = parser().parse_args(arguments)
    if isinstance(sys.stdout, TextIOWrapper):
        # a file's name may be no text: it is shown in escapes
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.reconfigure(errors="backslashreplace")
    try:
        code = _told(_run(options))
    except* AircraftError as group:
        _say(group)
        code = AIRCRAFT_DOWN
    except* UavmapError as group:
        _say(group)
        code = USER_ERROR
    except* KeyboardInterrupt:
        complain("interrupted")
        code = INTERRUPTED
    return code


def _told(code: int) -> int:
    """The exit code, with all that was printed on its way; who reads it may be gone."""
    try:
        sys.stdout.flush()
    except OSError:
        # else Python complains once more when it ends, and changes the exit code
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return code


def _say(group: BaseExceptionGroup[UavmapError]) -> None:
    for error in leaves(group):
        for line in str(error).splitlines():  # a mission file may have several faults
            complain(line)


def _run(options: argparse.Namespace) -> int:
    try:
        code: int = options.run(options)
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        name = str(error.filename or "an argument")
        raise UavmapError(f"{name[:60]}...: too long for the name of a file") from None
    return code
