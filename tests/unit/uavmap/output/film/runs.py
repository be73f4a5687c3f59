"""Simulated runs for several tests."""

import numpy as np

from missions.lab.arena.arena_run import Comms, run
from missions.lab.arena.radio import observe
from missions.lab.arena.roi import eden
from missions.mapping.tree import Tree
from missions.planning.stepwise import EXPLORERS
from missions.units import Cell
from uavmap.lab.run_film import film_of_run

START = Cell(0, 0)


def small_roi(cells=24, seed=5):
    return eden(cells, np.random.default_rng(seed))


def explored(roi, robots=2, comms=Comms.SHARED):
    return run(EXPLORERS["rdfs"], roi, START, robots, comms=comms)


def small_film(cells=24, robots=2):
    roi = small_roi(cells)
    return film_of_run(explored(roi, robots), roi, f"eden {cells}")


def tree_until(run_, roi, t):
    tree = observe(Tree.rooted(START), START, roi)

    def order(cell):
        away = (cell.east - START.east) ** 2 + (cell.north - START.north) ** 2
        return tree.vertices[cell].depth, -away, cell

    arrivals = {}
    for leg in run_.legs:
        if leg.end_t <= t:
            arrivals.setdefault(leg.end_t, set()).add(leg.end)
    for _, cells in sorted(arrivals.items()):
        for cell in sorted(cells, key=order):
            tree = observe(tree, cell, roi)
    return tree
