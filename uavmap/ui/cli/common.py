"""What several commands share: arguments, the results folder, the end of a command."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from missions.errors import OutputError, UavmapError
from missions.mission.schema import MAX_VEHICLES
from uavmap.base.atomic_write import write_text
from uavmap.output.summary import encode
from uavmap.ui.cli.endings import AIRCRAFT_DOWN, INCOMPLETE, complain
from uavmap.ui.cli.summary_table import print_summary

EXIT_CODES: Final = """\
exit codes:
  0    the mission is complete, everybody is at home
  2    something is wrong with the input, the link or a file; a line says what
  3    the flight is over, the mission is not complete
  4    an aircraft is down, or was left to its autopilot; a line says where. Also where the map is
       complete: "mission completed: yes" may come with it
  130  interrupted
"""


def number_type(kind: type[int] | type[float], low: float, high: float) -> Callable[[str], Any]:
    """The type of an option that takes a number within limits, both included.

    >>> number_type(int, 1, 9)("3")
    3
    """

    def number(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            what = "a whole number" if kind is int else "a number"
            raise argparse.ArgumentTypeError(f"{text!r} is not {what}") from None
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is not between {low:g} and {high:g}")
        return value

    return number


vehicle_count: Final = number_type(int, 1, MAX_VEHICLES)
worker_count: Final = number_type(int, 1, 256)
seed_number: Final = number_type(int, 0, 2**63 - 1)
"""Seeds that numpy takes."""
port_number: Final = number_type(int, 1, 65000)
"""Ports with room for those of more vehicles behind them."""
epsg_code: Final = number_type(int, 1024, 999_999)
index_number: Final = number_type(int, 0, 10**9)
speedup: Final = number_type(float, 0.001, 1000.0)


def utc_seconds(text: str) -> float:
    """A time of day with its zone, in seconds since 1970.

    >>> utc_seconds("1970-01-01T00:01:00.5Z")
    60.5
    """
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        time = None
    if time is None or time.tzinfo is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no time such as 2024-05-01T10:11:12Z")
    return time.timestamp()


def pair(what: str, text: str, expected: str) -> tuple[float, float]:
    """Two finite numbers with a comma between them, or an `UavmapError`: what is not as expected.

    >>> pair("--wind 6,270", "6,270", "SPEED,FROM")
    (6.0, 270.0)
    """
    try:
        one, other = (float(part) for part in text.split(","))
    except ValueError:
        one = other = math.nan
    if not (math.isfinite(one) and math.isfinite(other)):
        raise UavmapError(f"{what} is not {expected}")
    return one, other


def overwrite_nothing(folder: Path, names: Iterable[str]) -> None:
    """Raise `OutputError` when one of the files to be written lies in the folder of --out."""
    for name in names:
        if (folder / name).exists():
            raise OutputError(f"--out {folder}: holds a {name} already; choose another folder")


def print_figures(figures: Mapping[str, Any], out: Path | None, *, as_json: bool) -> bool:
    """Figures as JSON into a file, where there is one, and on standard output, where asked for.

    Returns whether they were printed. Raises `OutputError` when the disk refuses.
    """
    text = encode(figures) + "\n"
    if out is not None:
        try:
            write_text(out, text)
        except OSError as error:
            raise OutputError(f"{out} cannot be written: {error.strerror}") from None
    if as_json:
        sys.stdout.write(text)
    return as_json


def report(
    summary: Mapping[str, Any],
    folder: Path,
    *,
    as_json: bool,
    verbose: bool = False,
    goes_on: bool = True,
) -> int:
    """Print the result; returns the exit code, which does not depend on being read.

    `goes_on`: whether `uavmap resume` can go on with what is not completed.
    """
    with contextlib.suppress(OSError):
        print_summary(summary, folder, as_json=as_json, verbose=verbose)
    for line in summary.get("aircraft_down", ()):
        complain(line)
    if goes_on and not summary["completed"] and "aircraft_down" in summary:
        # a simulated world ends with its flight: the aircraft begin again at home
        how = "" if summary.get("seed") is None else " --from-home"
        complain(f"to go on: uavmap resume {folder}{how}")
    if summary.get("aircraft_down"):  # also where everything is mapped
        return AIRCRAFT_DOWN
    return 0 if summary["completed"] else INCOMPLETE
