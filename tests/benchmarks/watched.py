"""Simulated flights by the command itself, with an observer of the truth.

A mission file with faults added is flown by `uavmap fly --sim` in this process, on virtual time.
The true movements of the aircraft are observed from outside, and the outcome is compared with the
report of the command.
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from missions.events import Event, from_json
from missions.units import Cell
from tests.campaign.outcome import FORBIDDEN
from tests.e2e.rig import MISSIONS, bodies, roi_cells
from tests.referee import ProductReport, Referee
from tests.support.sitl_truth import Observer, ground_of, observed
from uavmap.ui.cli import main as uavmap_main


@dataclass(frozen=True, slots=True)
class WatchedFlight:
    name: str
    code: int | None
    """Exit status; None after a traceback."""
    summary: Mapping[str, Any]
    stderr: str
    """Text on standard error."""
    raised: str
    truth: Observer
    referee: Referee
    """Referee of the flight, with its findings."""
    events: tuple[Event, ...]
    kinds: Mapping[str, int]
    """Number of events by kind."""
    notes: tuple[str, ...]
    """Notes of orders that failed, and of actions of a guardian."""

    @property
    def columns(self) -> frozenset[str]:
        referee = self.referee
        far = any(referee.from_pad_m(n) > referee.bounds.home_m for n in referee.memories)
        found = {FORBIDDEN[kind] for kind, _ in referee.found}
        found |= {"crash"} if referee.crashed else set()
        found |= {"down"} if self.code == 4 else set()
        home = not (far or referee.in_the_air or referee.crashed)
        return frozenset(found | ({"home"} if home else set()))

    def line(self) -> str:
        craft = "; ".join(
            f"{number}: {memory.now.mode}{' IN THE AIR' if memory.now.flying else ' landed'}"
            f"{' CRASHED' if memory.now.crashed else ''}"
            f" {self.referee.from_pad_m(number):.0f} m from home"
            for number, memory in self.referee.memories.items()
        )
        last = self.raised.strip().splitlines()[-1:] or []
        return (
            f"{self.name}: exit {self.code} at {self.truth.t_s:.0f} s, missed "
            f"{self.summary.get('cells_missed')}; {craft}; {self.notes} {last} "
            f"{self.referee.found} {' '.join(sorted(self.columns))}"
        )


def mission_text(name: str, faults: Iterable[Mapping[str, object]] = ()) -> str:
    """Return a mission of the tests with faults added."""
    path = Path(name) if name.endswith(".toml") else MISSIONS / f"{name}.toml"
    text = path.read_text("utf-8")
    for fault in faults:
        lines = [f"{key} = {json.dumps(value)}" for key, value in fault.items()]
        text += "\n[[sim.faults]]\n" + "\n".join(lines) + "\n"
    return text


def fly_watched(
    name: str, text: str, seed: int, *more: str, observer: Observer | None = None
) -> WatchedFlight:
    """Fly a mission to its end; the observer may be one that interferes."""
    observer = Observer() if observer is None else observer
    err, out = io.StringIO(), io.StringIO()
    code, raised = None, ""
    with tempfile.TemporaryDirectory() as below, observed(observer):
        mission, folder = Path(below) / "mission.toml", Path(below) / "out"
        mission.write_text(text, encoding="utf-8")
        arguments = ["fly", mission, "--sim", "--seed", seed, "--json", "--out", folder, *more]
        try:
            with contextlib.redirect_stderr(err), contextlib.redirect_stdout(out):
                code = uavmap_main([str(a) for a in arguments])
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            raised = "".join(traceback.format_exception(error))
        summary = json.loads(out.getvalue()) if out.getvalue() else {}
        texts = bodies(folder)
        referee = observer.end(_reported(observer, code, summary, raised, folder))
    told = [json.loads(body) for body in texts]
    notes = tuple(
        f"{b['t_s']:.0f} s {b['kind']}: {b.get('order', b.get('action', b.get('mode', '')))}"
        f" {b.get('reason', '')}"
        for b in told
        if b["kind"] in ("order_failed", "guarded", "crashed", "given_up", "overridden")
    )
    events, kinds = tuple(map(from_json, texts)), Counter(b["kind"] for b in told)
    return WatchedFlight(
        name, code, summary, err.getvalue(), raised, observer, referee, events, kinds, notes
    )


def _reported(
    observer: Observer, code: int | None, summary: Mapping[str, Any], raised: str, folder: Path
) -> ProductReport:
    """Return the report of the command, and the true ground."""
    mapped, touched, owed = set[tuple[int, int]](), frozenset[Cell](), frozenset[Cell]()
    if observer.mission is not None and (folder / "map.geojson").exists():
        mapped, (touched, owed) = roi_cells(folder), ground_of(observer.mission)
    kind = "no end" if "no end" in raised else "traceback"
    return ProductReport(
        observer.t_s,
        code=code,
        completed=bool(summary.get("completed")),
        reported=observer.reported,
        region=touched,
        owed=owed,
        mapped=frozenset(Cell(*cell) for cell in mapped),
        missed_cells=observer.missed_cells,
        misjudged=observer.excuses_blind and observer.ever("blind"),
        faults=[(kind, raised.strip().splitlines()[-1])] if raised else (),
    )
