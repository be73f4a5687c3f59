"""Strategies on regions without flight, from Python."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from missions.errors import LinkError, RoiError, StrategyError, UavmapError
from missions.lab.arena.roi import Roi
from missions.lab.strategies import EXPLORERS
from missions.planning.stepwise.interface import Metric
from missions.planning.sweep.strategies import NONSTOP
from missions.units import LatLon
from uavmap.base.arguments import Paths, number, path_text, whole
from uavmap.base.extras import install_command
from uavmap.lab.roi_files import load_rois
from uavmap.lab.trials import Means, Terms, Trial, by_strategy, means, means_by_name, trials

if TYPE_CHECKING:
    import pandas

from missions.fleet_events import Partition
from missions.lab.arena.arena_run import Comms
from missions.lab.arena.radio import Links
from uavmap.fleet.simulated_radio import RANGE, parse_link_spec

MAX_ROBOTS = 1000
_SPEED_M_S = 6.0


@dataclass(frozen=True, slots=True)
class Simulated:
    """Runs of strategies on regions, each with its certificate.

    Attributes:
        runs: A mapping a run: `roi` and `strategy`, and the figures of `uavmap simulate --json`.
        means: The means of the figures over all regions, by strategy.
    """

    runs: tuple[Mapping[str, Any], ...]
    means: Mapping[str, Mapping[str, Any]]

    @property
    def table(self) -> pandas.DataFrame:
        """The runs as a DataFrame, a row a run (needs the extra `frames`).

        Raises `UavmapError` where pandas is not installed.
        """
        try:
            import pandas  # noqa: PLC0415 - an extra, and heavy
        except ImportError:
            raise UavmapError(f"runs as a table need pandas: {install_command('frames')}") from None
        return pandas.DataFrame([dict(run) for run in self.runs])


def simulate(
    roi: Paths | Roi | Iterable[Paths | Roi],
    *,
    strategy: str | Sequence[str] = "rdfs",
    robots: int = 1,
    speed: float | None = None,
    drift: tuple[float, float] = (0.0, 0.0),
    comms: str = "shared",
    cell_m: float = 4.0,
    start: tuple[float, float] | None = None,
    footprint_m: tuple[float, float] = (15.0, 15.0),
    accel_m_s2: float = 2.5,
    frame_s: float = 0.2,
    error_rate: float = 0.0,
    loss_rate: float = 0.0,
    seed: int = 1,
) -> Simulated:
    """Let perfect robots explore regions without flying, and compare the time with its bounds.

    The command `uavmap simulate` does the same.

    Args:
        roi: One region or several: a growth `"KIND:CELLS:SEED"` such as `"eden:120:7"`, a file of
            cells (JSON) or of polygons (GeoJSON), or a `missions.lab.arena.roi.Roi`.
        strategy: One strategy, or several to compare; `uavmap strategies` lists them. `swath` and
            `survey` do not stop over cells and count in seconds, the others in steps from cell to
            cell, so they cannot be mixed.
        robots: 1 to 1000.
        speed: Speed: of strategies that stop, in cells a unit of time (default 1); of `swath` and
            `survey` in m/s (default 6).
        drift: Drift of the region, for strategies that stop: its speed, in the unit of `speed`,
            and the bearing in degrees that it moves towards.
        comms: `"shared"`; `"meeting"`: robots share their knowledge only where they meet; or a
            radio, in cells and in the unit of time: `"range:8,loss:0.2,delay:1,rate:5"`.
        cell_m: Edge of a cell in metres, for GeoJSON, `swath` and `survey`.
        start: Latitude and longitude of the start of all robots, for GeoJSON.
        footprint_m: Ground in a frame, east and north, in metres (`swath`, `survey`).
        accel_m_s2: Acceleration (`swath`, `survey`).
        frame_s: Seconds from frame to frame (`swath`, `survey`).
        error_rate: Share of wrong votes, 0 to 0.4 (`swath`, `survey`).
        loss_rate: Share of lost frames, 0 to 0.4 (`swath`, `survey`).
        seed: Seed of these errors, and of the losses of a radio.

    Raises:
        LinkError: The radio is invalid.
        RoiError: A file or a growth is no region.
        StrategyError: A strategy is not known, or cannot do this.

    Examples:
        >>> done = simulate("eden:40:7", strategy=["rdfs", "greedy"], robots=3)
        >>> [run["strategy"] for run in done.runs]
        ['rdfs', 'greedy']
        >>> done.means["rdfs"]["makespan"] >= done.means["rdfs"]["lower_bound"]
        True
    """
    names = known_strategies([strategy] if isinstance(strategy, str) else strategy, "strategy = ")
    if not names:
        raise StrategyError("strategy is empty; name one")
    count = whole("robots", robots, 1, MAX_ROBOTS)
    rois = _rois(roi, number("cell_m", cell_m, 0.01, 10_000.0), start)
    fast = nonstop_among(names, f"strategy = {strategy!r}")
    if not fast:
        steps = number("speed", 1.0 if speed is None else speed, 1e-3, 1e3)
        metric = metric_of(steps, *drift, f"drift = {drift}")
        try:
            links = simulated_links(str(comms), count, whole("seed", seed, 0, 2**63 - 1))
        except ValueError as error:
            raise LinkError(f"comms = {comms!r}: {error}") from None
        explorers = [EXPLORERS[name] for name in names]
        return _simulated(list(trials(rois, explorers, Terms(count, metric, links))), names, means)
    if tuple(drift) != (0.0, 0.0) or comms != "shared":
        raise StrategyError(
            f"{', '.join(fast)}: simulated on resting regions only, and these vehicles always "
            "share what they know; leave out drift and comms"
        )
    from missions.lab.arena.nonstop import Camera, Team  # noqa: PLC0415 - numba takes a second
    from uavmap.lab import nonstop_trials as nonstop  # noqa: PLC0415 - as above

    speed_m_s = _SPEED_M_S if speed is None else number("speed", speed, 1e-3, 1e3)
    east_m, north_m = (number("footprint_m", side, 0.01, 1000.0) for side in footprint_m)
    camera = Camera(
        east_m,
        north_m,
        number("frame_s", frame_s, 0.02, 10.0),
        error_rate=number("error_rate", error_rate, 0.0, 0.4),
        loss_rate=number("loss_rate", loss_rate, 0.0, 0.4),
    )
    accel = number("accel_m_s2", accel_m_s2, 0.1, 20.0)
    team = Team(count, camera, cell_m, speed_m_s, accel)
    terms = nonstop.FlightTerms(team, seed=whole("seed", seed, 0, 2**63 - 1))
    done = list(nonstop.nonstop_trials(rois, [NONSTOP[name] for name in fast], terms))
    return _simulated(done, fast, nonstop.nonstop_means)


def known_strategies(names: Sequence[str], what: str) -> list[str]:
    """Return different names of strategies. Raises `StrategyError` for an unknown one."""
    different = list(dict.fromkeys(names))
    for name in different:
        if name not in EXPLORERS and name not in NONSTOP:
            known = ", ".join([*EXPLORERS, *NONSTOP])
            raise StrategyError(f"{what}{name!r} is not known; choose one of {known}")
    return different


def nonstop_among(names: Sequence[str], what: str) -> list[str]:
    """Return the names of strategies that do not stop: none, or all.

    Raises `StrategyError` for a mixture.
    """
    found = [name for name in names if name in NONSTOP]
    if found and len(found) < len(names):
        raise StrategyError(
            f"{what}: {', '.join(NONSTOP)} count in seconds, the others in steps; they cannot be "
            "compared in one table"
        )
    return found


def metric_of(speed: float, drift_speed: float, toward_deg: float, what: str) -> Metric:
    """Create the metric of a drifting region. Raises `UavmapError` for one that is too fast."""
    if not 0.0 <= drift_speed < speed:
        raise UavmapError(f"{what}: robots of speed {speed:g} do not keep up with it")
    bearing = math.radians(toward_deg)
    return Metric(speed, drift_speed * math.sin(bearing), drift_speed * math.cos(bearing))


def _simulated(done: Sequence[Trial], names: Sequence[str], means: Means) -> Simulated:
    rows = ({"roi": t.roi, "strategy": t.strategy, **t.figures} for t in done)
    return Simulated(tuple(rows), means_by_name(by_strategy(done, names), means))


def _rois(
    given: Paths | Roi | Iterable[Paths | Roi], cell_m: float, start: tuple[float, float] | None
) -> list[Roi]:
    several = [given] if isinstance(given, str | os.PathLike | Roi) else given
    place = None if start is None else LatLon(*start)
    found: list[Roi] = []
    for entry in several:
        if isinstance(entry, Roi):
            found.append(entry)
        else:
            found += load_rois(path_text("roi", entry), cell_m=cell_m, start=place)
    if not found:
        raise RoiError("roi is empty; name a region")
    return found


# --- the radio between robots on the grid ------------------------------------------------------
KINDS: Final = ("shared", "free", "meeting")
_KEYS: Final = ("loss", "delay", "rate")
_TIME: Final = r"([0-9]+(?:\.[0-9]+)?)"
_GROUPS: Final = r"[0-9]+(?:[+/][0-9]+)*"
_APART: Final = re.compile(f"{_TIME}-{_TIME}(?::({_GROUPS}))?", re.ASCII)
_APART_MEANT: Final = "apart:BEGIN-END, or with groups of robots apart:BEGIN-END:1+2/3+4"


def simulated_links(text: str, robots: int, seed: int) -> Comms | Links:
    """Read links; lengths in cells, times in steps. `free` is another word for `shared`.

    The seed is for the losses. Raises `ValueError` with the text and the remedy.

    >>> simulated_links("meeting", 3, 1)
    <Comms.MEETING: 'meeting'>
    >>> simulated_links("range:8,loss:0.2,apart:10-30:1+2", 3, 1).apart
    (Partition(begin=10.0, end=30.0, groups=(frozenset({0, 1}),)),)
    """
    words = parse_link_spec(text, KINDS, "CELLS", _KEYS, ("apart",))
    if words.kind == Comms.MEETING and (words.numbers or words.others):
        raise ValueError("meeting needs no radio; write meeting alone, or range")
    if words.kind == Comms.MEETING:
        return Comms.MEETING
    if words.kind != RANGE and not words.numbers and not words.others:
        return Comms.SHARED
    return Links(
        range_cells=words.numbers.get(RANGE, math.inf),
        loss=words.numbers.get("loss", 0.0),
        delay=words.numbers.get("delay", 0.0),
        rate=words.numbers.get("rate", math.inf),
        apart=tuple(_apart(text, robots) for _, text in words.others),
        seed=seed,
    )


def draws(comms: Comms | Links) -> bool:
    """Return True if a seed makes a difference.

    >>> draws(Links(loss=0.1)), draws(Links(loss=1.0)), draws(Comms.SHARED)
    (True, False, False)
    """
    return isinstance(comms, Links) and 0.0 < comms.loss < 1.0


def _apart(text: str, robots: int) -> Partition:
    """Read a partition; robots are numbered from 1."""
    found = _APART.fullmatch(text)
    if found is None:
        raise ValueError(f"apart:{text} is no time; write {_APART_MEANT}")
    begin, end = float(found[1]), float(found[2])
    if not begin < end:
        raise ValueError(f"apart:{text} ends before it begins; write {_APART_MEANT}")
    numbers = [[int(n) for n in group.split("+")] for group in (found[3] or "").split("/") if group]
    flat = [n for group in numbers for n in group]
    for robot in flat:
        if not 1 <= robot <= robots:
            raise ValueError(f"apart:{text}: robot {robot} is none of 1 to {robots}")
        if flat.count(robot) > 1:
            raise ValueError(f"apart:{text}: robot {robot} is named twice; leave one out")
    return Partition(begin, end, tuple(frozenset(n - 1 for n in group) for group in numbers))
