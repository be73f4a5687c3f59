"""The figures of a mission from its events: while it flies, or from its journal."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from missions.events import Event, FrameSeen
from missions.fleet_events import FactsShared
from missions.flight.state import Setting, State
from missions.flight.step import step
from missions.flight.team.members import concluded, facts_of, with_map
from missions.mapping.belief import FrameId
from missions.mapping.frame_sums import FrameSums
from missions.mapping.rim_cells import is_in_passing
from missions.mapping.tree import patches
from missions.planning.lower_bounds import one_way_lower_bound, passing_bound_s
from missions.units import GridPoint
from uavmap.output.facts.detector_fit import DetectorFit
from uavmap.output.facts.flight_log import Counter, FlightLog
from uavmap.output.facts.patch_certificates import certificates
from uavmap.output.facts.patch_drift import Shares
from vision.projection import SEEN_SHARE

WEAK_RATIO: Final = 20.0
"""Exploration in lower bounds above which the bound is too weak to be shown to operators."""


@dataclass(frozen=True, slots=True)
class Figures:
    """The figures of a flight, and the tracks of the vehicles.

    Attributes:
        flight_time_s: Airborne time of all vehicles.
        makespan_s: Time from the first lift-off to the last touch-down.
        exploration_s: Longest time of a vehicle on the tree, without search, paths from and to
            home, and swaps.
        bound_makespan_s: The strategy's upper bound on `exploration_s`; None without one.
        lower_bound_s: Least time of any team on the explored cells.
    """

    flight_time_s: float
    makespan_s: float
    distance_m: float
    sorties: int
    battery_swaps: int
    exploration_s: float
    lower_bound_s: float
    bound_makespan_s: float | None
    tracks: Mapping[int, tuple[tuple[float, GridPoint, float], ...]]
    navigation: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)
    """Accuracy of the positions of vehicles whose satellites were lost or wrong, by vehicle."""
    lift_off_s: float = 0.0
    """Mission time of the first lift-off in the journal."""
    shares: Shares = field(default_factory=Shares, compare=False, repr=False)
    """The votes of the journal's frames, which measure the drift of patches."""
    sums: FrameSums = field(default_factory=FrameSums, compare=False, repr=False)
    """Sums over its frames and those of other members for each cell: unsure, and classes."""
    fit: DetectorFit = field(default_factory=DetectorFit, compare=False, repr=False)
    passing: Sequence[FrameSeen] = field(default=(), compare=False, repr=False)
    """The frames that were taken in passing, which judge the rim."""
    log: FlightLog = field(default_factory=FlightLog, compare=False, repr=False)

    @property
    def is_compared(self) -> bool:
        """True if the lower bound is strong enough to compare the exploration with it."""
        return self.ratio is not None and self.ratio <= WEAK_RATIO

    @property
    def ratio(self) -> float | None:
        """Ratio of the exploration to the lower bound; None without an exploration."""
        return round(self.exploration_s / self.lower_bound_s, 3) if self.lower_bound_s else None

    @property
    def bound_held(self) -> bool | None:
        """Return whether the exploration stayed within the strategy's bound; None without one."""
        bound_s = self.bound_makespan_s
        return None if bound_s is None else self.exploration_s <= bound_s


class FlightRecord:
    """The record from which the results of a flight are made, event by event."""

    def __init__(self, setting: Setting) -> None:
        self._state = setting.initial_state()
        self._counter = Counter(self._state.vehicles)
        self._shares, self._fit = Shares(), DetectorFit()
        self._passing: list[FrameSeen] = []
        self._log = FlightLog()
        # members of a fleet do not share frames from a cell: each merged flight keeps its own
        in_fleet = setting.team.shares_facts and not setting.strategy.stops
        self._facts = facts_of(setting) if in_fleet else None
        self._sums = FrameSums(None if self._facts is None else self._facts.doubts)
        self.events = 0
        """Number of events noted."""

    def note(self, event: Event, state: State) -> None:
        """Note an event; `state` is the state after it."""
        self._counter.before(event, self._state)
        self._counter.after(event)
        self._log.note(event)
        if isinstance(event, FrameSeen | FactsShared):
            self._sums.note(event)
        if isinstance(event, FrameSeen):
            self._shares.note(event)
            self._fit.note(event)
            if is_in_passing(event):
                self._passing.append(event)
        if self._facts is not None:
            self._facts.add(event)
        self._state = state
        self.events += 1

    def figures(self) -> tuple[State, Figures]:
        """Return the last state and the figures."""
        state = self._state
        if self._facts is not None:
            state = concluded(with_map(state, self._facts))
        found = figures_of(state, self._counter)
        return state, replace(
            found, shares=self._shares, sums=self._sums, fit=self._fit,
            passing=self._passing, log=self._log,
        )  # fmt: skip


def figures(setting: Setting, events: Iterable[Event]) -> tuple[State, Figures]:
    """Fold a journal; return the final state and the figures."""
    record, state = FlightRecord(setting), setting.initial_state()
    for event in events:
        state, _ = step(state, event)
        record.note(event, state)
    return record.figures()


def figures_of(state: State, counter: Counter) -> Figures:
    """Return the figures of a flight up to a state; the counter has every event."""
    counts = counter.vehicles.values()
    return Figures(
        flight_time_s=round(sum(c.flight_s for c in counts), 1),
        makespan_s=round(max(counter.last_s - (counter.first_s or 0.0), 0.0), 1),
        distance_m=round(sum(c.distance_m for c in counts), 1),
        sorties=sum(c.sorties for c in counts),
        battery_swaps=sum(c.swaps for c in counts),
        exploration_s=round(max(c.on_task_s for c in counts), 1),
        lower_bound_s=_lower_bound_s(state, max(c.stints for c in counts) - 1),
        bound_makespan_s=None
        if state.tree is None
        else state.setting.strategy.bound_s(state.setting, state.tree),
        tracks={number: tuple(c.points) for number, c in counter.vehicles.items()},
        navigation={n: log for n, c in counter.vehicles.items() if (log := c.navigation.figures())},
        lift_off_s=counter.first_s or 0.0,
    )


def _lower_bound_s(state: State, breaks: int) -> float:
    """Return a lower bound on the time on the tree for any team, at the configured speed.

    A path from the root may end anywhere, and every return interrupts it. Cells count that were
    observed with all frames after the root was found; skipped cells do not count.
    """
    setting = state.setting
    tree = state.tree
    if tree is None or state.found_s is None:
        return 0.0
    if not setting.strategy.stops:
        return _passing_bound_s(state, state.found_s, breaks)
    votes, found_s = setting.mission.votes, state.found_s
    cells = [
        cell
        for cell in tree.vertices
        if cell not in state.abandoned
        and state.belief.fully_voted(cell)
        and all(frame.t_s > found_s for frame in state.belief.looks[cell])
    ]
    if tree.root in state.abandoned:
        breaks = max(breaks, 1)  # no vehicle began at the root
    look_s = (votes.frames - 1) * setting.mission.camera.interval_s
    metric = replace(setting.metric, look=look_s)
    robots = len(setting.mission.vehicles)
    return round(one_way_lower_bound(cells, tree.root, robots, metric, max(breaks, 0)), 1)


def _passing_bound_s(state: State, found_s: float, breaks: int) -> float:
    """Return the bound for vehicles that do not stop, on ground observed first after the root.

    A team that fell back on stopping flew a part at the mission's speed with any heading. A frame
    of a stop judges cells that are nearly whole in the picture.
    """
    mission = state.setting.mission
    legs_m_s = mission.flight.speed_m_s + mission.drift.speed_m_s if state.falls_back else 0.0
    vehicles, setting = state.vehicles.values(), state.setting
    team = [setting.kinematics(v.cruise_height_m, v.wind_m_s) for v in vehicles]
    top_m = max(v.cruise_height_m for v in vehicles)
    lean_m = 0.0
    for k in team:
        airspeed_m_s = max(k.speed_m_s, legs_m_s) + mission.wind.speed_m_s
        lean_m = max(lean_m, k.tilt_m_s2 * (k.accel_m_s2 + k.drag_1_s * airspeed_m_s))
    cells = sum(t_s > found_s for t_s in state.belief.first_seen_s().values())
    bound_s = passing_bound_s(
        (SEEN_SHARE if state.falls_back else 1.0) * cells * mission.grid.cell_m**2,
        len(team),
        max(breaks, 0),
        mission.camera.optics.footprint(top_m),
        lean_m,
        max(legs_m_s, *(k.speed_m_s for k in team)),
        turned=state.falls_back,
    )
    return round(bound_s, 1)


def frames_judged(state: State) -> int:
    """Return the number of judged pictures."""
    looks: Collection[FrameId] = state.belief.looks.get(None, {})
    overview: Collection[FrameId] = state.overview.looks.get(None, {})
    from_above = sum(frame not in looks for frame in overview)
    return sum(len(frames) for frames in state.belief.looks.values()) + from_above


def finding(state: State) -> str:
    """Write what the mission found, in a sentence about judged ground alone."""
    frames = frames_judged(state)
    left_m = sum(a.distance_to(b) for a, b in state.unsearched)
    if state.setting.strategy.patches and state.belief.roi:
        return _patches_found(state, frames, left_m)
    if state.surveyed and not state.setting.strategy.patches:
        found = f"{len(state.belief.roi)} cells of the region in {frames} judged frames"
        if state.undecided:
            return f"{found}; {len(state.undecided)} cells of the box lack votes"
        beyond = sum(
            any(state.belief.verdict(near) is None for near in cell.neighbours())
            for cell in state.belief.roi
        )
        rim = f"; at {beyond} cells it may go on beyond the box" if beyond else ""
        return f"{found}, the whole box surveyed{rim}"
    if state.tree is None:
        found = f"{len(state.belief.roi)} cells of the region" if state.belief.roi else "no region"
        text = f"{found} found in {frames} judged frames"
        if state.skipped:
            text += f"; {len(state.skipped)} suspicions were skipped by the operator"
        return f"{text}; {left_m:.0f} m of search lanes are not judged" if left_m else text
    reasons = (
        (state.abandoned, "could not be observed"),
        (state.undecided, "lack votes"),
        (state.skipped, "were skipped by the operator"),
    )
    gaps = [f"{len(cells)} cells {what}" for cells, what in reasons if cells]
    if not state.exploration_finished:
        gaps.append("it is not explored to its end")
    others = [p for p in patches(state.belief.roi) if p.isdisjoint(state.tree.vertices)]
    elsewhere = sum(len(patch) for patch in others)
    count = len(state.belief.roi) - elsewhere
    found = f"a patch of the region, {count} cells," if others else f"a region of {count} cells"
    found += f" in {frames} judged frames"
    text = f"{found}; {', '.join(gaps)}" if gaps else f"{found}, explored to its end"
    if not others:
        return text
    text += f"; {elsewhere} more cell{'s lie' if elsewhere > 1 else ' lies'} in"
    if len(others) == 1:
        return f"{text} another patch, which is not explored"
    return f"{text} {len(others)} other patches, which are not explored"


def _patches_found(state: State, frames: int, left_m: float) -> str:
    count = len(patches(state.belief.roi))
    several = "a patch" if count == 1 else f"{count} patches"
    text = f"{several} of the region, {len(state.belief.roi)} cells, in {frames} judged frames"
    if left_m:
        return f"{text}; {left_m:.0f} m of search lanes are not judged"
    if state.undecided:
        return f"{text}; {len(state.undecided)} cells lack votes"
    if not state.surveyed:
        return f"{text}; they are not explored to their ends"
    ends = "its end" if count == 1 else "their ends"
    return f"{text}, explored to {ends}; the whole box is seen"


def aircraft_down(state: State) -> list[str]:
    """List the aircraft that are down, each with its place, and those that may be down."""
    lines = []
    for number, vehicle in sorted(state.vehicles.items()):
        if vehicle.away:
            place = state.setting.grid.position(vehicle.position)
            where = f"{place.lat_deg:.6f}, {place.lon_deg:.6f}"
            lines.append(f"vehicle {number} near {where}: {vehicle.note or vehicle.phase.value}")
        elif number in state.unreported:
            lines.append(f"vehicle {number}: out of contact at the end, and may be down")
    return lines


def summary(state: State, found: Figures, seed: int | None) -> dict[str, Any]:
    """Create the part of summary.json that does not need the truth."""
    setting = state.setting
    mission, tree = setting.mission, state.tree
    of_patches, in_all = certificates(state, found.lift_off_s)
    drifts = found.shares.drifts_of(patches(state.belief.roi), setting.grid)
    for one, drift in zip(of_patches, drifts, strict=True):
        one["drift"] = None if drift is None else drift.figures(setting.grid)
    values = {
        "mission": mission.name,
        "strategy": mission.strategy,
        "vehicles": len(mission.vehicles),
        "seed": seed,
        "completed": state.completed,
        "finding": finding(state),
        "aircraft_down": aircraft_down(state),
        "frames_judged": frames_judged(state),
        "unsearched_m": round(sum((a.distance_to(b) for a, b in state.unsearched), 0.0), 1),
        "flight_time_s": found.flight_time_s,
        "makespan_s": found.makespan_s,
        "exploration_s": found.exploration_s,
        "distance_m": found.distance_m,
        "sorties": found.sorties,
        "battery_swaps": found.battery_swaps,
        "vertices": len(tree) if tree is not None else 0,
        "tree_depth": tree.depth if tree is not None else 0,
        "cells_roi": len(state.belief.roi),
        "patches": of_patches,
        "patches_in_all": in_all,
        "cells_abandoned": len(state.abandoned),
        "cells_undecided": len(state.undecided),
        "detections": len(state.belief.detections()),
        "false_positives": None,
        "false_negatives": None,
        "cells_missed": None,
        "iou_cells": None,
        "min_separation_m": None,
        "fence_breaches": None,
        "reserve_violations": None,
        "lower_bound_s": found.lower_bound_s,
        "ratio": found.ratio,
        "bound_makespan_s": found.bound_makespan_s,
        "bound_held": found.bound_held,
        "navigation": {str(number): dict(one) for number, one in found.navigation.items()},
        "notes": {str(number): v.note for number, v in sorted(state.vehicles.items()) if v.note},
    }
    if not setting.team.knows_orders:  # merged: no journal has the orders of all vehicles
        values |= dict.fromkeys(
            ("exploration_s", "lower_bound_s", "ratio", "bound_makespan_s", "bound_held")
        )
    return values
