"""The classes of a region on a map: cells, areas and volumes, each with its bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon, Polygon

from missions.classes import Classes
from missions.geo.grid import Grid
from missions.units import Cell
from uavmap.output.facts.cell_outlines import open_sides, outline


@dataclass(frozen=True, slots=True)
class ClassArea:
    """The cells of a class of the region, and its size.

    Attributes:
        outline: Outline of its cells, in the moving frame; may be empty.
        area_m2: Area of its cells.
        low_m2: Area of the class in its cells by frames, on average; half of that at its rim.
        high_m2: Area of its cells, and of the class in other cells by frames.
        thickness_um: Minimum thickness, and the maximum if there is one; None: not known.
    """

    number: int
    name: str
    cells: tuple[Cell, ...]
    outline: Polygon | MultiPolygon
    area_m2: float
    low_m2: float
    high_m2: float
    thickness_um: tuple[float, ...] | None

    @property
    def volume_l(self) -> tuple[float, float | None] | None:
        """Return minimum and maximum volume, litres: a micrometre on a square metre is 1 ml."""
        if self.thickness_um is None:
            return None
        least, *most = (um / 1000.0 for um in self.thickness_um)
        return self.low_m2 * least, self.high_m2 * most[0] if most else None

    def figures(self) -> dict[str, Any]:
        """Return the figures for files, with litres if the thickness is known."""
        found = {
            "number": self.number,
            "name": self.name,
            "cells": len(self.cells),
            "area_m2": round(self.area_m2, 1),
            "area_low_m2": round(self.low_m2, 1),
            "area_high_m2": round(self.high_m2, 1),
        }
        if self.volume_l is None:
            return found
        low_l, high_l = self.volume_l
        volume_l = [round(low_l, 3), None if high_l is None else round(high_l, 3)]
        return {**found, "volume_l": volume_l}


def class_figures(classes: Sequence[ClassArea]) -> dict[str, Any]:
    """Return the classes and their total volume for the summary; empty without classes."""
    if not classes:
        return {}
    found: dict[str, Any] = {"classes": [one.figures() for one in classes]}
    volumes_l = [one.volume_l for one in classes if one.volume_l is not None]
    if volumes_l:
        low_l, high_l = zip(*volumes_l, strict=True)
        most_l = None if None in high_l else round(sum(high_l), 3)
        found["volume_l"] = [round(sum(low_l), 3), most_l]
    return found


def class_areas(
    classes: Classes,
    grid: Grid,
    cells: NDArray[np.int32],
    shares: NDArray[np.float64],
    which: NDArray[np.intp],
) -> tuple[ClassArea, ...]:
    """Return the classes of the region, by number.

    Args:
        cells: All cells of a map, (n, 2).
        shares: Mean share of each class of the region in the cells, (n, classes).
        which: Column of each cell's class, -1 for no class, (n,).
    """
    cell_m2, found = grid.cell_m**2, []
    for column, number in enumerate(classes.explored):
        name, share, there = classes.names[number], shares[:, column], which == column
        own = tuple(Cell(*cell) for cell in cells[there].tolist())
        rim = np.zeros(len(cells), np.bool_)
        rim[there] = open_sides(cells[there]).any(axis=1)
        inside_m2, rim_m2, other_m2 = (
            float(share[some].sum()) * cell_m2 for some in (there, rim, ~there)
        )
        area_m2 = len(own) * cell_m2
        found.append(
            ClassArea(
                number, name, own, outline(own, grid), area_m2, inside_m2 - rim_m2 / 2.0,
                area_m2 + other_m2, classes.by_name[name].thickness_um,
            )
        )  # fmt: skip
    return tuple(found)
