"""How robots find out where they are: `python -m tests.benchmarks.planning.localization [FILE...]`.

Prints the paper's ratios, the bounds on random grids, whether a map ever makes a method slower, the
planner beside the Homing Robot with the same map and beside the best of all plans, and how often
what is said with 95 % certainty is right. FILEs hold ROIs as `{"rois": [{"start", "cells"}]}`;
without any, ROIs are grown.

    --grids N   random grids for the bounds (default 10000)
    --rois N    only the first N of each file (default 10)
    --runs N    with errors, of each method on each file (default 1000)
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from statistics import fmean

import numpy as np

from missions.lab.arena.roi import KINDS, grown
from missions.lab.localization.grid_map import GridMap
from missions.lab.localization.grids import chevrons, cluttered, studded
from missions.lab.localization.localization_planner import Planner
from missions.lab.localization.localization_run import localize
from missions.lab.localization.methods import METHODS
from missions.lab.localization.noisy_run import localize_with_errors
from missions.units import Cell
from uavmap.lab.studies.homing_robot import ERRORS

FEW_ALIKE = 130
"""The best of all plans is looked for on maps of at most so many cells."""


def ratios() -> None:
    """Figure 6 and Lemma 8."""
    for k, m in ((20, 40), (60, 120)):
        cells, start = chevrons(k, m)
        known = GridMap.of(cells)
        moves = localize(known, start, METHODS["homing"], np.random.default_rng(1)).moves
        print(f"G_{k},{m}: n = {known.size}, homing {moves} moves, {moves / known.size:.3f} n")
    known = GridMap.of(studded(50))
    print(f"G_50: c / b = {known.circumnavigation / known.size:.3f}")


def bounds(grids: int) -> None:
    """Violations on random grids: of bounds, of answers, and by a map that makes it slower."""
    found: Counter[str] = Counter()
    most: dict[str, float] = {}
    began = time.perf_counter()
    for seed in range(grids):
        rng = np.random.default_rng(seed)
        if seed % 2:
            width, height = (int(side) for side in rng.integers(1, 25, size=2))
            known = GridMap.of(cluttered(width, height, float(rng.uniform(0.0, 0.45)), rng))
        else:
            kind = sorted(KINDS)[seed // 2 % len(KINDS)]
            known = GridMap.of(grown(kind, int(rng.integers(1, 250)), seed).cells)
        start, planner = known.cells[int(rng.integers(known.size))], Planner(known)
        for name, method in METHODS.items():
            if name in ("blum-kozen", "random") and seed >= grids // 10:
                continue  # O(n^2) moves
            with_map = localize(known, start, method, np.random.default_rng(seed), planner)
            done = [with_map]
            if not method.needs_map:
                done.append(localize(known, start, method, np.random.default_rng(seed)))
                found[f"{name}: later with a map"] += with_map.moves > done[1].moves
            bound = None if method.bound is None else method.bound(known.size)
            for one in done:
                found[f"{name}: wrong"] += not one.right
                found[f"{name}: above its bound"] += bound is not None and one.moves > bound
                most[name] = max(most.get(name, 0.0), one.moves / known.size)
    print(f"{grids} random grids, {time.perf_counter() - began:.0f} s; violations:")
    for what, count in found.items():
        print(f"  {what}: {count}")
    print("  most moves / n:", ", ".join(f"{name} {value:.2f}" for name, value in most.items()))


def plans(name: str, maps: list[GridMap]) -> None:
    """The planner beside the Homing Robot with a map, from every cell."""
    moves: dict[str, list[float]] = {"homing": [], "plan": [], "best": []}
    most = began = 0.0
    rng = np.random.default_rng(1)
    for known in maps:
        planner = Planner(known)
        for method in ("homing", "plan"):
            began -= time.perf_counter() if method == "plan" else 0.0
            done = [localize(known, at, METHODS[method], rng, planner) for at in known.cells]
            began += time.perf_counter() if method == "plan" else 0.0
            moves[method].append(fmean(one.moves for one in done))
            if method == "plan":
                most = max(most, max(one.moves for one in done) / known.size)
        if known.size <= FEW_ALIKE:
            moves["best"].append(Planner(known, exact=known.size).expected_moves())
    homing, plan = fmean(moves["homing"]), fmean(moves["plan"])
    best = f"{fmean(moves['best']):.3f}" if moves["best"] else "-"
    print(
        f"{name}, {len(maps)} maps: homing {homing:.3f}, plan {plan:.3f} ({plan / homing:.2f} of "
        f"it), best of all plans {best}; plan at most {most:.3f} n, {began / len(maps):.2f} s a map"
    )


def errors(name: str, maps: list[GridMap], runs: int) -> None:
    """How often what is said is right."""
    for method in METHODS.values():
        began, done = time.perf_counter(), []
        for seed in range(runs):
            rng, known = np.random.default_rng(seed), maps[seed % len(maps)]
            start = known.cells[int(rng.integers(known.size))]
            done.append(localize_with_errors(known, start, method, ERRORS, rng))
        took_ms = (time.perf_counter() - began) / runs * 1000
        print(
            f"{name}, {method.name}, {runs} runs: right {fmean(o.right for o in done):.3f}, stated "
            f"{fmean(o.confidence for o in done):.3f}, moves {fmean(o.moves for o in done):.2f} "
            f"(most {max(o.moves for o in done)}), gave up {sum(o.answer is None for o in done)}, "
            f"{took_ms:.1f} ms a run"
        )


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(description="localization: bounds, plans, errors")
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--grids", type=int, default=10_000)
    parser.add_argument("--rois", type=int, default=10)
    parser.add_argument("--runs", type=int, default=1000)
    options = parser.parse_args()
    sets: dict[str, Callable[[], list[GridMap]]] = {
        f"{kind} {cells}": lambda kind=kind, cells=cells: [
            GridMap.of(grown(kind, cells, seed).cells) for seed in range(options.rois)
        ]
        for kind in ("eden", "ragged")
        for cells in (120, 500)
    }
    for file in options.files:
        sets[file.stem] = lambda file=file: [
            GridMap.of({Cell(*cell) for cell in roi["cells"]})
            for roi in json.loads(file.read_text("utf-8"))["rois"][: options.rois]
        ]
    ratios()
    if options.grids:
        bounds(options.grids)
    for name, read in sets.items():
        maps = read()
        plans(name, maps)
        if options.runs:
            errors(name, maps, options.runs)


if __name__ == "__main__":
    main()
