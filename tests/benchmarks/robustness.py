"""Outcome of a flight with a fault: `python -m tests.benchmarks.robustness`.

    python -m tests.benchmarks.robustness --seeds 3                 a table, some 30 flights
    python -m tests.benchmarks.robustness --only baseline --seeds 1

The mission `runway` is flown whole in the simulator by its own strategy (`swath`), once for each
fault and seed. Faults of position, wind and camera are those of the simulator. The benchmark
itself, and not the product, loses pictures as they are fetched and falsifies verdicts as they are
given. Random values follow from the seed. The table has medians over the seeds, in brackets least
and most if they differ.
"""

from __future__ import annotations

import contextlib
import re
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np

import uavmap.runner.simulation
from missions.errors import LinkError
from missions.flight.setting_of import setting_of
from missions.mission.schema import Mission
from sitl.scenario import Setup
from tests.benchmarks import frame
from tests.support.plans import named_text
from tests.support.small_missions import first_patch
from uavmap.aircraft.imaging.classifier import Classifier
from uavmap.load.mission_source import load
from uavmap.output.facts.score import CLEAR_SHARE, cells_near, shares_of, true_roi
from vision.projection import Frame, Verdict

MISSION = "runway"
STRATEGY = "swath"
SEARCH_FRAMES = 30
"""Number of frames after which the false frame is the next one without a cell of the region."""
GUST_EVERY_S, GUST_FOR_S, GUSTS_UNTIL_S = 60, 6, 1800
WIND_FROM_DEG = 250.0

Inject = Callable[[int], AbstractContextManager[None]]
Change = Callable[[str], str]


# --- verdicts and pictures -----------------------------------------------------------------------
@contextlib.contextmanager
def _verdicts(change: Callable[[tuple[Verdict, ...]], tuple[Verdict, ...]]) -> Iterator[None]:
    judged = Classifier._judge  # the one place where all verdicts are given

    def changed(self: Classifier, frame: Frame, *where: Any) -> tuple[Verdict, ...]:
        return change(judged(self, frame, *where))

    with mock.patch.object(Classifier, "_judge", changed):
        yield


@contextlib.contextmanager
def flipped_votes(seed: int, share: float) -> Iterator[None]:
    rng = np.random.default_rng([seed, 1])

    def change(votes: tuple[Verdict, ...]) -> tuple[Verdict, ...]:
        wrong = rng.random(len(votes)) < share
        return tuple(
            replace(vote, positive=not vote.positive) if flip else vote
            for vote, flip in zip(votes, wrong, strict=True)
        )

    with _verdicts(change):
        yield


@contextlib.contextmanager
def false_frame(_: int) -> Iterator[None]:
    """Have one frame of the search, where there is no region, show region everywhere."""
    mission = load(MISSION)
    grid = setting_of(mission).grid
    truth = true_roi(mission, grid)
    shares = shares_of(cells_near(truth, grid), truth, grid)
    region = {cell for cell, share in shares.items() if share >= CLEAR_SHARE}
    frames, lied = 0, False

    def change(votes: tuple[Verdict, ...]) -> tuple[Verdict, ...]:
        nonlocal frames, lied
        frames += 1
        beside = votes and not any(vote.cell in region for vote in votes)
        if lied or frames <= SEARCH_FRAMES or not beside:
            return votes
        lied = True
        return tuple(replace(vote, positive=True) for vote in votes)

    with _verdicts(change):
        yield
    if not lied:
        raise RuntimeError("no frame of the search was outside of the region")


@contextlib.contextmanager
def lost_pictures(seed: int, share: float) -> Iterator[None]:
    rng = np.random.default_rng([seed, 2])
    fetch = uavmap.runner.simulation.Simulation.fetch

    async def lossy(self: uavmap.runner.simulation.Simulation, url: str) -> bytes:
        if rng.random() < share:
            raise LinkError(f"{url}: lost by the benchmark")
        return await fetch(self, url)

    with mock.patch.object(uavmap.runner.simulation.Simulation, "fetch", lossy):
        yield


@contextlib.contextmanager
def slow_camera(_: int) -> Iterator[None]:
    """Have the camera take half as many pictures as in the mission file, without any report."""
    setup_of = uavmap.runner.simulation.setup_of

    def slower(mission: Mission, *args: Any, **more: Any) -> Setup:
        setup = setup_of(mission, *args, **more)
        interval_s = 2.0 * mission.camera.interval_s
        return replace(setup, camera=replace(setup.camera, min_interval_s=interval_s))

    with mock.patch.object(uavmap.runner.simulation, "setup_of", slower):
        yield


def nothing(_: int) -> AbstractContextManager[None]:
    return contextlib.nullcontext()


# --- mission files -------------------------------------------------------------------------------
def _sim(line: str) -> Change:
    return lambda text: text.replace("[sim]\n", f"[sim]\n{line}\n")


def _gusts(more_m_s: float) -> Change:
    def change(text: str) -> str:
        for at_s in range(GUST_EVERY_S, GUSTS_UNTIL_S, GUST_EVERY_S):
            text += (
                f'\n[[sim.faults]]\nkind = "wind_gust"\nat_s = {at_s}\nfor_s = {GUST_FOR_S}\n'
                f"m_s = {more_m_s}\nfrom_deg = {WIND_FROM_DEG}\n"
            )
        return text

    return change


def _same(text: str) -> str:
    return text


def _half_rate(text: str) -> str:
    return re.sub(r"interval_s = 0\.2\b", "interval_s = 0.4", text)


TROUBLES: Mapping[str, tuple[Change, Inject]] = {
    "baseline (position error 0.3 m)": (_same, nothing),
    "one false frame in the search": (_same, false_frame),
    "20 % of the frames lost": (_same, lambda seed: lost_pictures(seed, 0.20)),
    "5 % of the votes wrong": (_same, lambda seed: flipped_votes(seed, 0.05)),
    "position error 1.5 m": (_sim("gps_sigma_m = 1.5"), nothing),
    "gusts to 8 m/s, 6 s in a minute": (_gusts(4.4), nothing),
    "gusts to 10 m/s, 6 s in a minute": (_gusts(6.4), nothing),
    "gusts of 10 m/s on top (13.6 m/s)": (_gusts(10.0), nothing),
    "camera at half its rate, unknown": (_same, slow_camera),
    "camera at half its rate, in the file": (_half_rate, nothing),
}


# --- flights -------------------------------------------------------------------------------------
def flight(job: tuple[str, int]) -> dict[str, Any]:
    name, seed = job
    change, inject = TROUBLES[name]
    text = change(first_patch(named_text(MISSION).text))
    if (text == first_patch(named_text(MISSION).text)) != (change is _same):
        raise RuntimeError(f"{name}: the mission {MISSION} has no place for it")
    with inject(seed):
        return frame.summary_of(MISSION, text, strategy=STRATEGY, vehicles=1, seed=seed)


def _median(values: Sequence[float], digits: int) -> str:
    """Return the median, and least and most if they differ.

    >>> _median([2.0, 1.0, 4.0], 1), _median([3, 3, 3], 0)
    ('2.0 [1.0, 4.0]', '3')
    """
    middle, *ends = (
        f"{v:.{digits}f}" for v in (statistics.median(values), min(values), max(values))
    )
    return middle if ends == [middle, middle] else f"{middle} [{', '.join(ends)}]"


COLUMNS = {
    "flight, min": ("flight_time_s", 1.0 / 60.0, 1),
    "exploration, s": ("exploration_s", 1.0, 0),
    "cells missed": ("cells_missed", 1.0, 0),
    "IoU, %": ("iou_cells", 100.0, 1),
    "false +": ("false_positives", 1.0, 0),
    "false -": ("false_negatives", 1.0, 0),
}
"""Columns by heading: the figure, its factor, and digits."""


def row(name: str, found: Sequence[Mapping[str, Any]]) -> str:
    complete = f"{sum(bool(f['completed']) for f in found)} of {len(found)}"
    cells = (
        _median([factor * f[key] for f in found], digits)
        for key, factor, digits in COLUMNS.values()
    )
    return frame.row(name, complete, *cells)


def main() -> None:
    options = frame.options_of(__doc__, seeds=3, workers=1, only=("",))
    names = [name for name in TROUBLES if any(part in name for part in options.only)]
    jobs = [(name, seed) for name in names for seed in range(1, options.seeds + 1)]
    print(frame.head("", "completed", *COLUMNS), flush=True)
    flights = frame.in_turn(flight, jobs, options.workers)
    for name in names:
        found = [next(flights)[1] for _ in range(options.seeds)]
        print(row(name, found), flush=True)


if __name__ == "__main__":
    main()
