"""What several commands share: arguments, the results folder, the closing table."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from missions.errors import JournalError
from uavmap.flight import JOURNAL

INCOMPLETE: Final = 3
RESULTS: Final = "results"

_SHOWN: Final = {
    "completed": "mission completed",
    "flight_time_s": "flight time, s",
    "makespan_s": "makespan, s",
    "distance_m": "distance, m",
    "sorties": "sorties",
    "battery_swaps": "battery swaps",
    "vertices": "tree vertices",
    "cells_roi": "ROI cells",
    "cells_missed": "cells missed",
    "iou_cells": "IoU with the truth",
    "detections": "detections",
    "false_positives": "false positives",
    "false_negatives": "false negatives",
    "min_separation_m": "least separation, m",
    "fence_breaches": "fence breaches",
    "reserve_violations": "reserve violations",
    "exploration_s": "exploration, s",
    "bound_makespan_s": "bound on exploration, s",
    "bound_held": "bound held",
    "photographs": "photographs",
}


def positive_int(text: str) -> int:
    """An argument that counts something."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not 1 or more")
    return value


def seed_number(text: str) -> int:
    """A seed: numpy takes no negative ones."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is not 0 or more")
    return value


def port_number(text: str) -> int:
    """A port, with room for those of more vehicles behind it."""
    value = int(text)
    if not 0 < value <= 65000:
        raise argparse.ArgumentTypeError(f"{text} is not between 1 and 65000")
    return value


def positive_float(text: str) -> float:
    """An argument that is a factor."""
    value = float(text)
    if not 0.0 < value <= 1000.0:
        raise argparse.ArgumentTypeError(f"{text} is not above 0 and at most 1000")
    return value


def results_folder(out: str | None, name: str) -> Path:
    """The folder for a run: the one asked for, or a new one under `results`.

    Raises `JournalError` when a mission lies in it already: nothing is ever overwritten.
    """
    if out is not None:
        folder = Path(out)
        if folder.exists() and not folder.is_dir():
            raise JournalError(f"--out {folder} is a file, not a folder")
        if (folder / JOURNAL).exists():
            raise JournalError(
                f"--out {folder} holds a mission already; go on with `uavmap resume {folder}`, "
                "or choose another folder"
            )
        return folder
    for number in range(1, 10_000):
        folder = Path(RESULTS) / f"{name}-{number}"
        if not folder.exists():
            return folder
    raise JournalError(f"{RESULTS} is full; give --out")


def report(summary: Mapping[str, Any], folder: Path, *, as_json: bool) -> int:
    """Print the result; returns the exit code."""
    if as_json:
        json.dump({**summary, "out": str(folder)}, sys.stdout, indent=2)
        sys.stdout.write("\n")
    else:
        _table(summary)
        print(f"results in {folder}")
    return 0 if summary["completed"] else INCOMPLETE


def _table(summary: Mapping[str, Any]) -> None:
    table = Table(title=f"{summary['mission']} ({summary['strategy']})", title_justify="left")
    table.add_column("figure")
    table.add_column("value", justify="right")
    for key, label in _SHOWN.items():
        value = summary.get(key)
        if value is not None:
            shown = {True: "yes", False: "no"}.get(value) if isinstance(value, bool) else None
            table.add_row(label, shown or f"{value:,}".replace(",", " "))
    Console().print(table)
    for number, note in summary.get("notes", {}).items():
        print(f"vehicle {number}: {note}")
