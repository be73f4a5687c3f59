"""The figures of flights of real autopilots.

They are kept in `figures.json` and shown as one table in `docs/reference/real-autopilots.md`:
`python -m tests.real.figures` writes the table again.
"""

from __future__ import annotations

import datetime
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from tests.real.referee import Referee
    from uavmap.output.facts.score import Score

ROOT: Final = Path(__file__).parents[2]
KEPT: Final = Path(__file__).with_name("figures.json")
PAGE: Final = ROOT / "docs" / "reference" / "real-autopilots.md"
BEGIN: Final = "<!-- flights of real autopilots -->"
END: Final = "<!-- end of the flights -->"
NAMES: Final = {"ardupilot": "ArduCopter", "px4": "PX4"}


@dataclass(slots=True)
class Row:
    autopilot: str
    scenario: str
    date: str = ""
    version: str = ""
    speed: float = 0.0
    """Requested speed, times real time."""
    held: float = 0.0
    """Speed that was kept, times real time."""
    load: float = 0.0
    """Load of the computer, as the flight began."""
    right: bool = False
    code: int | None = None
    detail: str = ""
    makespan_s: float | None = None
    iou: float | None = None
    missed: int | None = None
    apart_m: float | None = None
    outside: int | None = None
    put_back: str = ""
    simulated: str = ""
    """Figures with `--sim`: makespan, IoU (medians of five seeds), most missed cells."""

    def add_flight(self, summary: Mapping[str, Any], referee: Referee, score: Score | None) -> None:
        if summary.get("completed"):  # for a part of a mission they have no meaning
            self.makespan_s = summary["makespan_s"]
            self.iou = None if score is None else round(score.iou_cells, 3)
            self.missed = None if score is None else score.cells_missed
        least_m = referee.judge.nearest_m
        self.apart_m = round(least_m, 1) if math.isfinite(least_m) else None
        self.outside = referee.breaches

    def keep(self, path: Path = KEPT) -> None:
        """Replace the last flight of the same scenario by this row."""
        self.date = datetime.datetime.now(datetime.UTC).date().isoformat()
        rows = {(row.autopilot, row.scenario): row for row in [*kept(path), self]}
        found = [rows[key] for key in sorted(rows)]
        path.write_text(json.dumps([asdict(row) for row in found], indent=1) + "\n", "utf-8")


def kept(path: Path = KEPT) -> list[Row]:
    if not path.exists():
        return []
    known = {field.name for field in fields(Row)}
    return [
        Row(**{key: value for key, value in row.items() if key in known})
        for row in json.loads(path.read_text("utf-8"))
    ]


def summary_of(folder: Path) -> dict[str, Any]:
    """Return the summary of a flight; empty if there is none."""
    path = folder / "summary.json"
    found: dict[str, Any] = json.loads(path.read_text("utf-8")) if path.exists() else {}
    return found


def simulated(found: Sequence[Mapping[str, Any]]) -> str:
    """Return the figures of simulated flights for a row: medians, and the most missed cells."""
    makespan_s = median(summary["makespan_s"] for summary in found)
    iou = median(summary["iou_cells"] for summary in found)
    return f"{makespan_s:.0f} s, {iou:.3f}, {max(summary['cells_missed'] for summary in found)}"


def table(rows: Iterable[Row]) -> str:
    lines = [
        "| autopilot | scenario | date | speed, held | outcome | makespan s | IoU, missed "
        "| `--sim`: s, IoU, missed | least distance m | left the fence | put back |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        outcome = "right" if row.right else "**WRONG**"
        outcome += "" if row.code is None else f", exit {row.code}"
        outcome += f": {row.detail}" if row.detail else ""
        cells = (
            f"{NAMES[row.autopilot]} {row.version}", row.scenario, row.date,
            f"{row.speed:g}x, {row.held:.2f}x", outcome, _text_of(row.makespan_s, ".0f"),
            "" if row.iou is None else f"{row.iou:.3f}, {row.missed}", row.simulated,
            _text_of(row.apart_m, ".1f"), _text_of(row.outside, "d"), row.put_back,
        )  # fmt: skip
        lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    return "\n".join(lines)


def _text_of(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def written(page: str, rows: Iterable[Row]) -> str:
    before, rest = page.split(BEGIN)
    return f"{before}{BEGIN}\n{table(rows)}\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text("utf-8"), kept()), "utf-8")
