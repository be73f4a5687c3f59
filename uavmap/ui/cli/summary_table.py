"""The summary of a flight or a replay in the terminal: what an operator wants, first."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from rich.markup import escape
from rich.table import Table

from uavmap.base.terminal import PipeConsole
from uavmap.journal.mission_time import duration
from uavmap.output.facts.patch_summary import box_in_words, lines

OUTLINES: Final = ("boundary.geojson", "map.geojson")
"""Files with the outline of the region, the finest first."""
PICTURES: Final = ("map.png", "report.html", "ortho.tif")

_FIGURES: Final = {
    "frames_judged": "frames judged",
    "unsearched_m": "search lanes without a judged frame, m",
    "flight_time_s": "flight time, s",
    "makespan_s": "makespan, s",
    "distance_m": "distance, m",
    "sorties": "sorties",
    "battery_swaps": "battery swaps",
    "vertices": "tree vertices",
    "tree_depth": "depth of the tree",
    "cells_roi": "region cells",
    "cells_missed": "cells missed",
    "iou_cells": "IoU with the truth",
    "detections": "detections",
    "false_positives": "false positives",
    "false_negatives": "false negatives",
    "min_separation_m": "least separation, m",
    "fence_breaches": "fence breaches",
    "reserve_violations": "reserve violations",
    "exploration_s": "exploration, s",
    "lower_bound_s": "lower bound on it, s",
    "ratio": "exploration / lower bound",
    "bound_makespan_s": "strategy's bound, s",
    "bound_held": "bound held",
    "photographs": "photographs",
    "photographs_judged": "of these judged",
    "photographs_refused": "of these refused",
    "photographs_twice": "copies of others",
    "cells_seen": "cells seen",
    "pictures_per_cell": "pictures a cell",
}
"""Keys of the summary that only `--verbose` shows, with their names."""
_ALARMS: Final = ("fence_breaches", "reserve_violations")
"""Those that are shown always where they are not 0."""


def add_summary_options(parser: argparse.ArgumentParser) -> None:
    """Add `--json` and `--verbose`."""
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.add_argument(
        "--verbose", action="store_true", help="print every figure of the summary, with bounds"
    )


def print_summary(
    summary: Mapping[str, Any], folder: Path, *, as_json: bool, verbose: bool
) -> None:
    """Print what came out of a flight or a replay."""
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
    if "patches" in summary:  # not of a replay
        for line in lines(summary["patches"], summary["patches_in_all"], verbose=verbose):
            print(line)
    for number, note in summary.get("notes", {}).items():
        print(f"vehicle {number}: {note}")
    print(summary.get("finding", ""))
    print(f"results in {folder}")


def rows(summary: Mapping[str, Any], folder: Path) -> Iterator[tuple[str, str]]:
    """Name and value of what an operator wants to know.

    >>> summary = {"completed": True, "area_m2": 2064.0, "area_low_m2": 1477.4,
    ...            "area_high_m2": 2243.5, "makespan_s": 222.3, "cells_undecided": 2}
    >>> for row in rows(summary, Path("results/none")):
    ...     print(*row, sep=": ")
    mission completed: yes
    area: 2,064 sq m (1,477 to 2,244)
    time: 3 min 42 s
    not seen: 2 cells undecided
    """
    yield "mission completed", "yes" if summary["completed"] else "no"
    if (area_m2 := summary.get("area_m2", summary.get("cells_roi_m2"))) is not None:
        low_m2, high_m2 = summary.get("area_low_m2"), summary.get("area_high_m2")
        known = low_m2 is not None and high_m2 is not None
        yield "area", f"{area_m2:,.0f} sq m" + (f" ({low_m2:,.0f} to {high_m2:,.0f})" * known)
    yield from _files("outline", folder, OUTLINES[:1] if _has(folder, OUTLINES[0]) else OUTLINES)
    if (time_s := summary.get("makespan_s")) is not None:
        yield "time", duration(time_s)
    if (photographs := summary.get("photographs")) is not None:
        yield "photographs", f"{summary['photographs_judged']:,} of {photographs:,} judged"
    yield "not seen", not_seen(summary) or "nothing"
    for key in _ALARMS:
        if summary.get(key):
            yield _FIGURES[key], f"{summary[key]:,}"
    yield from _files("pictures", folder, PICTURES)


def _has(folder: Path, name: str) -> bool:
    return (folder / name).is_file()


def _files(what: str, folder: Path, names: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    found = [str(folder / name) for name in names if _has(folder, name)]
    if found:
        yield what, ", ".join(found)


def not_seen(summary: Mapping[str, Any]) -> str:
    """What the cameras have not shown, or not often enough; empty where that is nothing."""
    parts = []
    if (in_all := summary.get("patches_in_all")) is not None and not in_all["box"]["whole"]:
        box = box_in_words(in_all["box"])
        parts.append(f"search box: {box}; a patch may be missing there")
    if cells := summary.get("cells_undecided"):
        parts.append(f"{cells:,} {'cell' if cells == 1 else 'cells'} undecided")
    if lanes_m := summary.get("unsearched_m"):
        parts.append(f"{lanes_m:,.0f} m of search lanes")
    return "; ".join(parts)


def figures(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Name and value of every other figure.

    >>> list(figures({"ratio": 4.589, "bound_held": True, "lower_bound_s": None}))
    [('exploration / lower bound', '4.589'), ('bound held', 'yes')]
    """
    for key, name in _FIGURES.items():
        value = summary.get(key)
        if isinstance(value, bool):
            yield name, "yes" if value else "no"
        elif value is not None:
            yield name, f"{value:,}"
