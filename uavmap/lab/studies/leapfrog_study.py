"""The gain of two multicopters of which one hovers and tracks the other by a marker.

The mapper flies straight paths and lanes; its place is followed with several draws of the noise,
tracked and by the same odometer alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from missions.lab.cooperation.leapfrog_errors import Comparison, LeapfrogNoise, compare
from missions.lab.cooperation.space import Point
from missions.planning.leapfrog_geometry import TrackerView, plan_leapfrog
from uavmap.lab.studies.study_model import COLOURS, MARKERS, Figure, Page, Study, Table, trial_seed

STRAIGHT_M: Final = (50, 100, 200, 400)
LANES, LANE_M, APART_M = 6, 60.0, 6.0
ABOVE_M: Final = (10.0, 12.0)
DRIFTS_DEG: Final = (0.1, 0.3)
RUNS, QUICK_RUNS = 200, 6


@dataclass(frozen=True, slots=True)
class Flying:
    """A path, how much higher the tracker flies, and the gyro's drift after a metre."""

    name: str
    path: tuple[Point, ...]
    above_m: float
    drift_deg: float
    seeds: tuple[int, ...]


Result = tuple[Flying, Comparison]


def lanes() -> tuple[Point, ...]:
    """Return a lawn-mower pattern."""
    rows = (((0.0, i * APART_M), (LANE_M, i * APART_M)) for i in range(LANES))
    return tuple(place for i, row in enumerate(rows) for place in (row[::-1] if i % 2 else row))


def jobs(quick: bool, seed: int) -> list[Flying]:
    """Return every path, from every height, with every gyro."""
    lengths = STRAIGHT_M[:2] if quick else STRAIGHT_M
    paths: list[tuple[str, tuple[Point, ...]]] = [
        (f"straight, {m} m", ((0.0, 0.0), (float(m), 0.0))) for m in lengths
    ]
    if not quick:
        paths.append((f"{LANES} lanes of {LANE_M:.0f} m", lanes()))
    seeds = tuple(trial_seed(seed, i) for i in range(QUICK_RUNS if quick else RUNS))
    return [
        Flying(name, path, above_m, drift_deg, seeds)
        for drift_deg in DRIFTS_DEG
        for above_m in ABOVE_M
        for name, path in paths
    ]


def trial(job: Flying) -> Result:
    """Fly one path with all draws."""
    sighted = LeapfrogNoise.of_tracker(job.above_m)
    noise = LeapfrogNoise(place_m=sighted.place_m, drift_rad=math.radians(job.drift_deg))
    plan = plan_leapfrog(job.path, TrackerView(above_m=job.above_m))
    return job, compare(plan, noise, job.seeds)


_COLUMNS: Final = (
    "path", "m", "tracker above, m", "gyro, deg after 1 m", "hops", "tracked, m", "alone, m",
    "times better", "NEES tracked", "NEES alone",
)  # fmt: skip
_NOTES: Final = """\
Two multicopters fly without satellites. One maps, the other hovers above and sees the marker on its
top. Then the mapper hovers, and the tracker flies on in sight of it. The camera has 78 degrees
across at 4:3, the marker is 0.4 m wide.

Errors are those of the mapper's place after each hop, root mean square of {runs} flights. Odometers
read 2 % of the distance too much or too little, the same all through a flight. Headings are those
of a gyro, because a compass fails beneath steel: {drifts} degrees after a metre,
growing with the root of the way. Sightings err by half a degree of attitude, and by 0.12 degrees of
heading. A hovering vehicle compares the ground with its picture at the stop, to 2 cm and 0.05
degrees. Both start with a known heading.

Tracked errors are {worst:.1f} to {best:.1f} times smaller. The limit is the heading that one
hands to the other, not the place. With a better gyro one vehicle alone keeps north as well, so the
gain is smaller. NEES of the last place is 2 for an honest filter.
"""


def conclude(results: Sequence[Result]) -> Page:
    """Set all flights beside dead reckoning."""
    rows = tuple(
        (
            job.name, round(found.path_m, 1), job.above_m, job.drift_deg, found.hops,
            found.tracked_m, found.alone_m, found.times_better, found.tracked_nees,
            found.alone_nees,
        )
        for job, found in results
    )  # fmt: skip
    better = [found.times_better for _, found in results]
    text = _NOTES.format(
        runs=len(results[0][0].seeds), drifts=" or ".join(f"{d:g}" for d in DRIFTS_DEG),
        worst=min(better), best=max(better),
    )  # fmt: skip
    table = Table(_COLUMNS, rows)
    return Page("One hovers and tracks the other", text, table, lambda f: _draw(f, results))


def _draw(figure: Figure, results: Sequence[Result]) -> None:
    straight = [(job, found) for job, found in results if len(job.path) == 2]
    for axes, drift in zip(figure.subplots(1, 2, sharey=True), DRIFTS_DEG, strict=True):
        for colour, marker, above_m in zip(COLOURS, MARKERS, ABOVE_M, strict=False):
            mine = [f for job, f in straight if (job.above_m, job.drift_deg) == (above_m, drift)]
            lengths = [found.path_m for found in mine]
            axes.plot(
                lengths, [f.tracked_m for f in mine], marker + "-", color=colour,
                label=f"tracked from {above_m:g} m above",
            )  # fmt: skip
        axes.plot(lengths, [f.alone_m for f in mine], "D--", color=COLOURS[6], label="alone")
        axes.set(
            xscale="log", yscale="log", xlabel="path, m", title=f"gyro {drift:g} deg after a metre"
        )
        axes.xaxis.set_minor_formatter("")
    figure.axes[0].set_ylabel("error of place, m")
    figure.axes[0].legend(fontsize="small")


STUDY: Final = Study(
    "leapfrog", "one multicopter hovers and tracks the other by a marker", jobs, trial, conclude
)
