"""Simulated runs that several tests look at."""

from __future__ import annotations

import numpy as np

from missions.lab.arena.arena_run import Comms, Run, run
from missions.lab.arena.radio import look
from missions.lab.arena.roi import eden
from missions.mapping.tree import Tree
from missions.planning.stepwise import EXPLORERS
from missions.units import Cell
from uavmap.lab.run_film import film_of_run
from uavmap.output.film.film import Film

START = Cell(0, 0)


def small_roi(cells: int = 24, seed: int = 5) -> set[Cell]:
    return eden(cells, np.random.default_rng(seed))


def explored(roi: set[Cell], robots: int = 2, comms: Comms = Comms.SHARED) -> Run:
    return run(EXPLORERS["rdfs"], roi, START, robots, comms=comms)


def small_film(cells: int = 24, robots: int = 2) -> Film:
    roi = small_roi(cells)
    return film_of_run(explored(roi, robots), roi, f"eden {cells}")


def tree_until(run_: Run, roi: set[Cell], t: float) -> Tree:
    tree = look(Tree.rooted(START), START, roi)

    def order(cell: Cell) -> tuple[int, int, Cell]:
        away = (cell.east - START.east) ** 2 + (cell.north - START.north) ** 2
        return tree.vertices[cell].depth, -away, cell

    arrivals: dict[float, set[Cell]] = {}
    for leg in run_.legs:
        if leg.end_t <= t:
            arrivals.setdefault(leg.end_t, set()).add(leg.end)
    for _, cells in sorted(arrivals.items()):
        for cell in sorted(cells, key=order):
            tree = look(tree, cell, roi)
    return tree
