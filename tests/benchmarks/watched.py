"""Simulated flights by the command itself, with an observer who sees what is really the case.

A mission file with faults added is flown by `uavmap fly --sim` in this process, on virtual time.
What the aircraft really do is watched from outside, and the outcome is held against what the
command says of it.
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

from shapely.geometry import Point

import uavmap.runner.simulation
from missions.events import Event, from_json
from missions.flight.state import Setting
from missions.guardian import PAD_M
from missions.units import GridPoint
from sitl.vehicle import SimVehicle
from tests.e2e.rig import MISSIONS, bodies
from uavmap.runner.simulation import Truth
from uavmap.ui.cli import main as uavmap_main

LIMIT_S = 20_000.0
"""A flight that takes longer, in simulated seconds, has no end."""
SEEN_TO_S = 60.0
"""So soon after it left the fence a vehicle is on the ground, or in its autopilot's own return."""
FAR_M = 150.0
INSIDE_M = 0.5
"""A fence is left when it is left by more than the position wavers."""
PAD_WAVER_M = 2.0
"""How far the position may be off that a vehicle lands by."""

LIES = ("gps_glitch", "gps_drift")
"""Faults under which nobody can know where a vehicle stands."""
RIM_CELLS = 1
"""So many cells of the rim, half of them region, may come out as not: that is noise, not a lie."""


class NoEndError(Exception):
    """A flight that does not end by itself."""


@dataclass(slots=True)
class Aircraft:
    landed: bool = True
    crashed: bool = False
    from_home_m: float = 0.0
    outside_m: float = 0.0
    """How far outside of the fence it was at most."""
    unheld_m: float = 0.0
    """... before it was in RTL or LAND."""
    outside_s: float = 0.0
    """How long it was outside at most, until it was on the ground or in RTL or LAND."""
    mode: str = ""
    _left_s: float | None = None
    _home: GridPoint | None = None

    def look(self, vehicle: SimVehicle, setting: Setting) -> None:
        truth = vehicle.truth
        self.landed, self.crashed, self.mode = truth.landed, truth.crashed, truth.mode.name
        point = setting.grid.fixed(truth.position)
        if self._home is None:
            self._home = setting.grid.fixed(vehicle.spec.home)
        self.from_home_m = point.distance_to(self._home)
        outside_m = 0.0
        if not setting.fence.contains(point):
            outside_m = float(setting.fence.outer.distance(Point(point)))
        if truth.landed or outside_m <= INSIDE_M:
            self._left_s = None
            if truth.landed:
                return
        self.outside_m = max(self.outside_m, outside_m)
        if outside_m <= INSIDE_M or self.mode in ("RTL", "LAND"):
            self._left_s = None
            return
        if self._left_s is None:
            self._left_s = truth.t_s
        self.unheld_m = max(self.unheld_m, outside_m)
        self.outside_s = max(self.outside_s, truth.t_s - self._left_s)


@dataclass(slots=True)
class Observer(Truth):
    """The truth of a flight, and more of it than the command shows."""

    aircraft: dict[int, Aircraft] = field(default_factory=dict)
    t_s: float = 0.0
    limit_s: float = LIMIT_S

    def watch(self, vehicles: Sequence[SimVehicle], setting: Setting) -> None:
        Truth.watch(self, vehicles, setting)
        for vehicle in vehicles:
            self.t_s = vehicle.t_s
            seen = self.aircraft.setdefault(vehicle.spec.system_id, Aircraft())
            seen.look(vehicle, setting)
        if self.t_s > self.limit_s:
            raise NoEndError(f"no end after {self.limit_s:g} s")


@dataclass(frozen=True, slots=True)
class Flown:
    name: str
    code: int | None
    """The exit status; None after a traceback."""
    summary: Mapping[str, Any]
    said: str
    """Everything on standard error."""
    raised: str
    truth: Observer
    events: tuple[Event, ...]
    kinds: Mapping[str, int]
    """Events by kind."""
    notes: tuple[str, ...]
    """Of orders that failed, and what a guardian did."""

    @property
    def _missed(self) -> int:
        return int(self.summary.get("cells_missed") or 0)

    @property
    def columns(self) -> frozenset[str]:
        craft = self.truth.aircraft.values()
        # who lies or stands elsewhere: by the truth, not by what the positions say
        away = any(c.from_home_m > PAD_M + PAD_WAVER_M and c.landed for c in craft)
        air = any(not c.landed for c in craft)
        crashed = any(c.crashed for c in craft)
        told = bool(self.summary.get("aircraft_down")) or self.code == 4
        found = {
            "home": not (away or air or crashed),
            "down": self.code == 4,
            "air": air,
            "crash": crashed,
            "breach": any(c.outside_m > INSIDE_M for c in craft),
            "late": any(c.outside_s > SEEN_TO_S for c in craft),
            "far": any(c.unheld_m > FAR_M for c in craft),
            "res": self.truth.reserve_violations > 0,
            "lie": self.code == 0 and (self._missed > RIM_CELLS or crashed or air),
            "unrep": (crashed or air or (away and not self.name.startswith(LIES))) and not told,
            "end": "no end" in self.raised,
            "tb": bool(self.raised) and "no end" not in self.raised,
        }
        return frozenset(name for name, holds in found.items() if holds)

    def line(self) -> str:
        craft = "; ".join(
            f"{number}: {c.mode}{' landed' if c.landed else ' IN THE AIR'}"
            f"{' CRASHED' if c.crashed else ''} {c.from_home_m:.0f} m from home,"
            f" out {c.outside_m:.0f} m {c.outside_s:.0f} s"
            for number, c in self.truth.aircraft.items()
        )
        last = self.raised.strip().splitlines()[-1:] or []
        return (
            f"{self.name}: exit {self.code} at {self.truth.t_s:.0f} s, missed "
            f"{self.summary.get('cells_missed')}; {craft}; {self.notes} {last} "
            f"{' '.join(sorted(self.columns))}"
        )


def mission_text(name: str, faults: Iterable[Mapping[str, object]] = ()) -> str:
    """A mission of the tests with faults added."""
    path = Path(name) if name.endswith(".toml") else MISSIONS / f"{name}.toml"
    text = path.read_text("utf-8")
    for fault in faults:
        lines = [f"{key} = {json.dumps(value)}" for key, value in fault.items()]
        text += "\n[[sim.faults]]\n" + "\n".join(lines) + "\n"
    return text


def flown(name: str, text: str, seed: int, *more: str, observer: Observer | None = None) -> Flown:
    """Fly a mission to its end; the observer may be one that interferes."""
    observer = Observer() if observer is None else observer
    said, out = io.StringIO(), io.StringIO()
    code, raised = None, ""
    with tempfile.TemporaryDirectory() as below, _observed(observer):
        mission, folder = Path(below) / "mission.toml", Path(below) / "out"
        mission.write_text(text, encoding="utf-8")
        arguments = ["fly", mission, "--sim", "--seed", seed, "--json", "--out", folder, *more]
        try:
            with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
                code = uavmap_main([str(a) for a in arguments])
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            raised = "".join(traceback.format_exception(error))
        summary = json.loads(out.getvalue()) if out.getvalue() else {}
        texts = bodies(folder)
    told = [json.loads(body) for body in texts]
    notes = tuple(
        f"{b['t_s']:.0f} s {b['kind']}: {b.get('order', b.get('action', b.get('mode', '')))}"
        f" {b.get('reason', '')}"
        for b in told
        if b["kind"] in ("order_failed", "guarded", "crashed", "given_up", "overridden")
    )
    events, kinds = tuple(map(from_json, texts)), Counter(b["kind"] for b in told)
    return Flown(name, code, summary, said.getvalue(), raised, observer, events, kinds, notes)


@contextlib.contextmanager
def _observed(observer: Observer) -> Iterator[None]:
    class Watched(uavmap.runner.simulation.Simulation):
        def __init__(self, *values: Any, **more: Any) -> None:
            super().__init__(*values, **more)
            self.truth = observer

    with mock.patch.object(uavmap.runner.simulation, "Simulation", Watched):
        yield
