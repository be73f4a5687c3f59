"""The record of runs, `runs.json`: an entry for each commit, target and seed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from tests.campaign.record import commit_of_program
from tests.fuzz.engine import Result

KEPT: Final = Path(__file__).with_name("runs.json")
Row = dict[str, Any]


def row(target: str, seed: int, minutes: float, result: Result) -> Row:
    return {
        "target": target, "seed": seed, "minutes": minutes, "commit": commit_of_program(),
        "executions": result.executions, "branches": result.edges, "failures": sorted(result.found),
    }  # fmt: skip


def kept(path: Path = KEPT) -> list[Row]:
    return json.loads(path.read_text("utf-8")) if path.exists() else []


def keep(new: Row, path: Path = KEPT) -> None:
    rows = [*kept(path), new]
    path.write_text("[\n" + ",\n".join(map(json.dumps, rows)) + "\n]\n", "utf-8")
