"""The record of campaigns, `flights.json`: an entry for each commit, world, options and seed range.

`docs/reliability.md` is written from it.
"""

from __future__ import annotations

import json
import subprocess
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

from .outcome import Outcome

ROOT: Final = Path(__file__).parents[2]
KEPT: Final = Path(__file__).with_name("flights.json")


@dataclass(frozen=True, slots=True)
class Run:
    """The results of the flights of a seed range."""

    commit: str
    """The program that flew; it ends in `+` if files had changed since."""
    world: str
    options: str
    """Options other than the defaults, as the command takes them."""
    seed: int
    """The first seed."""
    flights: int
    kinds: Mapping[str, int]
    """Flights by injected trouble; two troubles in one flight are `pairs`."""
    columns: Mapping[str, int]
    """Flights by outcome, as in the table of `tests.campaign`."""
    forgiven: Mapping[str, int]
    """Use of each forgiveness."""
    found: Sequence[tuple[str, str, str]]
    """Each fault: the flight, its kind, and what happened."""

    @property
    def key(self) -> tuple[str, str, str, int]:
        return self.world, self.options, self.commit, self.seed


def run_of(commit: str, world: str, options: str, seed: int, outcomes: Sequence[Outcome]) -> Run:
    """Return the record of a campaign's outcomes."""
    return Run(
        commit, world, options, seed, len(outcomes),
        dict(sorted(Counter(outcome.label for outcome in outcomes).items())),
        dict(sorted(Counter(name for outcome in outcomes for name in outcome.counts).items())),
        dict(sorted(sum((outcome.forgiven for outcome in outcomes), Counter[str]()).items())),
        [(outcome.plan, kind, text) for outcome in outcomes for kind, text in outcome.found],
    )  # fmt: skip


def kept(path: Path = KEPT) -> list[Run]:
    """Return the runs of a record; without the file there are none."""
    if not path.exists():
        return []
    names = [field.name for field in fields(Run)]
    rows: list[dict[str, Any]] = json.loads(path.read_text("utf-8"))
    return [
        Run(**{name: row[name] for name in names} | {"found": [tuple(f) for f in row["found"]]})
        for row in rows
    ]


def keep(run: Run, path: Path = KEPT) -> None:
    """Write a run into a record; it replaces one of the same seeds, options and commit."""
    runs = {each.key: each for each in [*kept(path), run]}
    lines = [json.dumps(asdict(runs[key]), ensure_ascii=False) for key in sorted(runs)]
    path.write_text("[\n" + ",\n".join(lines) + "\n]\n", "utf-8")


def commit_of_program() -> str:
    """Return the short commit of this clone, with `+` after it if code differs from it."""
    head = _git("rev-parse", "--short=8", "HEAD")
    changed = _git("status", "--porcelain", "--untracked-files=no", "--", "*.py", "*.toml")
    return head + ("+" if changed else "")


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()
