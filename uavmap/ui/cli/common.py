"""Parts that several commands share: arguments, questions, the results and their summary."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from rich.markup import escape
from rich.table import Table

from missions.errors import AreaError, OutputError, UavmapError
from uavmap.base.terminal import PipeConsole
from uavmap.journal.flight_plan import RANGES
from uavmap.journal.mission_time import duration
from uavmap.output.documents import save
from uavmap.output.drawing.judged import FILE as JUDGED
from uavmap.output.facts.detector_fit import REMEDY
from uavmap.output.summary import box_in_words, class_lines, encode, lines, litres_in_words
from uavmap.ui.cli import AIRCRAFT_DOWN, INCOMPLETE, NO_VERDICT, complain

EXIT_CODES: Final = """\
exit codes:
  0    the mission is complete, and all vehicles are at home
  2    the input, the link or a file is wrong; a line names the fault
  3    the flight is over, and the mission is not complete
  4    an aircraft is down or was left to its autopilot, even if the map is complete; a line gives
       its place
  5    the flight is over, and the detector does not fit the ground: no verdict
  130  interrupted
"""


def number_type(kind: type[int] | type[float], low: float, high: float) -> Callable[[str], Any]:
    """Create the type of an option for a number within limits, both included.

    >>> number_type(int, 1, 9)("3")
    3
    """

    def number(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            expected = "a whole number" if kind is int else "a number"
            raise argparse.ArgumentTypeError(f"{text!r} is not {expected}") from None
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is not between {low:g} and {high:g}")
        return value

    return number


vehicle_count: Final = number_type(int, *RANGES["vehicles"])
worker_count: Final = number_type(int, 1, 256)
seed_number: Final = number_type(int, *RANGES["seed"])
port_number: Final = number_type(int, 1, 65000)
"""A port, with room above it for the ports of more vehicles."""
epsg_code: Final = number_type(int, 1024, 999_999)
index_number: Final = number_type(int, 0, 10**9)
speedup: Final = number_type(float, *RANGES["speedup"])


def utc_seconds(text: str) -> float:
    """Read a time with its zone; return seconds since 1970.

    >>> utc_seconds("1970-01-01T00:01:00.5Z")
    60.5
    """
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        time = None
    if time is None or time.tzinfo is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a time with its zone, such as 2024-05-01T10:11:12Z"
        )
    return time.timestamp()


def pair(what: str, text: str, expected: str) -> tuple[float, float]:
    """Read two finite numbers separated by a comma.

    Raises `UavmapError` with the line that `what` is not `expected`.

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


def refuse_existing(folder: Path, names: Iterable[str]) -> None:
    """Raise `OutputError` if the folder of --out has one of the files to be written."""
    for name in names:
        if (folder / name).exists():
            raise OutputError(f"--out {folder}: already has a {name}; choose another folder")


def print_figures(figures: Mapping[str, Any], out: Path | None, *, as_json: bool) -> bool:
    """Write figures as JSON to a file, if given, and to standard output, if `as_json`.

    Return whether they were printed. Raises `OutputError`.
    """
    text = encode(figures) + "\n"
    if out is not None:
        save(out, text.encode())
    if as_json:
        sys.stdout.write(text)
    return as_json


def is_interactive() -> bool:
    """Return whether a person can answer at the terminal."""
    return sys.stdin is not None and sys.stdin.isatty()


def ask(question: str) -> str:
    """Ask at the terminal and return the answer. Raises `AreaError` for an empty one."""
    sys.stderr.write(f"{question} ")
    sys.stderr.flush()
    line = sys.stdin.readline()
    if not line.strip():
        raise AreaError(f"no answer to the question: {question}")
    return line.strip()


def confirm(question: str) -> bool:
    """Ask at the terminal; return whether the answer is yes."""
    print(f"{question} [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def report(
    summary: Mapping[str, Any],
    folder: Path,
    *,
    as_json: bool,
    verbose: bool = False,
    can_resume: bool = True,
) -> int:
    """Print the result; return the exit code. `can_resume`: `uavmap resume` can continue it."""
    with contextlib.suppress(OSError):
        print_summary(summary, folder, as_json=as_json, verbose=verbose)
    for line in summary.get("aircraft_down", ()):
        complain(line)
    if reason := summary.get("no_verdict"):
        complain(f"no verdict: {reason}; {REMEDY}")
    elif summary.get("flown_to_the_end"):
        complain("to decide the unsure cells, paint pictures of them and train the detector again")
    elif can_resume and not summary["completed"] and "aircraft_down" in summary:
        # a simulated world ends with its flight: the aircraft start again at home
        from_home = "" if summary.get("seed") is None else " --from-home"
        complain(f"to continue: uavmap resume {folder}{from_home}")
    if summary.get("aircraft_down"):  # even if the map is complete
        return AIRCRAFT_DOWN
    if summary.get("no_verdict"):
        return NO_VERDICT
    return 0 if summary["completed"] else INCOMPLETE


NEXT: Final = "next.txt"
OUTLINES: Final = ("boundary.geojson", "map.geojson")
"""Files with the outline of the region; the finest is first."""
PICTURES: Final = ("map.png", JUDGED, "report.html", "report.pdf", "ortho.tif")

_FIGURES: Final = {
    "frames_judged": "frames judged",
    "unsearched_m": "search lanes without a judged frame, m",
    "flight_time_s": "flight time, s",
    "makespan_s": "makespan, s",
    "distance_m": "flown distance, m",
    "sorties": "sorties",
    "battery_swaps": "battery swaps",
    "vertices": "vertices of the tree",
    "tree_depth": "depth of the tree",
    "cells_roi": "cells of the region",
    "cells_missed": "cells missed",
    "iou_cells": "IoU with the true region",
    "detections": "detections",
    "false_positives": "false positives",
    "false_negatives": "false negatives",
    "min_separation_m": "least separation, m",
    "fence_breaches": "fence breaches",
    "reserve_violations": "reserve violations",
    "exploration_s": "exploration time, s",
    "lower_bound_s": "lower bound of exploration, s",
    "ratio": "exploration / lower bound",
    "bound_makespan_s": "bound of the strategy, s",
    "bound_held": "bound kept",
    "photographs": "photographs",
    "photographs_judged": "photographs judged",
    "photographs_refused": "photographs refused",
    "photographs_twice": "photographs that are copies",
    "cells_seen": "cells seen",
    "pictures_per_cell": "pictures per cell",
}
"""Keys of the summary that only `--verbose` shows, with their names."""
_ALARMS: Final = ("fence_breaches", "reserve_violations")
"""Keys that are always shown if their value is not 0."""


def print_summary(
    summary: Mapping[str, Any], folder: Path, *, as_json: bool, verbose: bool
) -> None:
    """Print the result of a flight or a replay."""
    if as_json:
        print(json.dumps({**summary, "out": str(folder)}, indent=2))
        return
    table = Table(
        title=escape(f"{summary['mission']} ({summary['strategy']})"),
        title_justify="left",
        show_header=False,
    )
    for name, value in (*rows(summary, folder), *(figures(summary) if verbose else ())):
        table.add_row(name, escape(value))
    PipeConsole().print(table)
    if "patches" in summary:  # a replay has none
        for line in lines(summary["patches"], summary["patches_in_all"], verbose=verbose):
            print(line)
    for line in class_lines(summary.get("classes", ())):
        print(line)
    for number, note in summary.get("notes", {}).items():
        print(f"vehicle {number}: {note}")
    print(summary.get("finding", ""))
    print(f"results in {folder}")


def rows(summary: Mapping[str, Any], folder: Path) -> Iterator[tuple[str, str]]:
    """Yield name and value of the figures that an operator needs.

    >>> summary = {"completed": True, "area_m2": 2064.0, "area_low_m2": 1477.4,
    ...            "area_high_m2": 2243.5, "makespan_s": 222.3, "cells_undecided": 2}
    >>> for row in rows(summary, Path("results/none")):
    ...     print(*row, sep=": ")
    mission completed: yes
    area: 2,064 sq m (1,477 to 2,244)
    time: 3 min 42 s
    not seen: 2 cells undecided
    """
    if (photographs := summary.get("photographs")) is not None:
        yield "photographs", f"{summary['photographs_judged']:,} of {photographs:,} in the map"
    else:
        ended = "no verdict" if summary.get("no_verdict") else "no"
        yield "mission completed", "yes" if summary["completed"] else ended
    if (area_m2 := summary.get("area_m2", summary.get("cells_roi_m2"))) is not None:
        low_m2, high_m2 = summary.get("area_low_m2"), summary.get("area_high_m2")
        known = low_m2 is not None and high_m2 is not None
        yield "area", f"{area_m2:,.0f} sq m" + (f" ({low_m2:,.0f} to {high_m2:,.0f})" * known)
    if litres := litres_in_words(summary.get("volume_l")):
        yield "volume", litres
    yield from _files("outline", folder, OUTLINES[:1] if _has(folder, OUTLINES[0]) else OUTLINES)
    if (time_s := summary.get("makespan_s")) is not None:
        yield "time", duration(time_s)
    yield "not seen", not_seen(summary) or "nothing"
    for key in _ALARMS:
        if summary.get(key):
            yield _FIGURES[key], f"{summary[key]:,}"
    yield from _files("pictures", folder, PICTURES)
    if summary.get("cells_unsure"):
        yield from _files("paint next", folder, (NEXT,))


def _has(folder: Path, name: str) -> bool:
    return (folder / name).is_file()


def _files(kind: str, folder: Path, names: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    found = [str(folder / name) for name in names if _has(folder, name)]
    if found:
        yield kind, ", ".join(found)


def not_seen(summary: Mapping[str, Any]) -> str:
    """Write which places the cameras have not shown, or not often enough; empty for none."""
    parts = []
    if (in_all := summary.get("patches_in_all")) is not None and not in_all["box"]["whole"]:
        box = box_in_words(in_all["box"])
        parts.append(f"search box: {box}; a patch may be missing there")
    if cells := summary.get("cells_undecided"):
        parts.append(f"{cells:,} {'cell' if cells == 1 else 'cells'} undecided")
    if cells := summary.get("cells_unsure"):
        many = "cell is" if cells == 1 else "cells are"
        parts.append(
            f"{cells:,} {many} unlike the examples of the detector "
            f"({summary['cells_unsure_m2']:,.0f} sq m, unsure)"
        )
    if lanes_m := summary.get("unsearched_m"):
        parts.append(f"{lanes_m:,.0f} m of search lanes")
    return "; ".join(parts)


def figures(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield name and value of the other figures.

    >>> list(figures({"ratio": 4.589, "bound_held": True, "lower_bound_s": None}))
    [('exploration / lower bound', '4.589'), ('bound kept', 'yes')]
    """
    for key, name in _FIGURES.items():
        value = summary.get(key)
        if isinstance(value, bool):
            yield name, "yes" if value else "no"
        elif value is not None:
            yield name, f"{value:,}"
