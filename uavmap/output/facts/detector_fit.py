"""Whether the detector of a flight fits the ground: a fact of its journal.

A flight whose detector marks nearly all ground, or none although it was not chosen for that ground,
ends without a verdict.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from missions.events import FrameSeen
from missions.flight.state import Setting, State
from missions.mission.sections import DetectorSection
from missions.units import Cell
from uavmap.output.facts.map_model import CellTable

FIRST_FRAMES: Final = 100
"""Number of frames after which the operator receives the share of region."""
LEAST_FRAMES: Final = 20
"""Minimum number of frames for a statement about the detector."""
MOST_REGION: Final = 0.9
"""Share of the cells seen that look like region from which on the detector hardly fits."""
REMEDY: Final = (
    "look at what it marks (`uavmap look`), and choose another one or teach it (`uavmap tune`)"
)


class News(NamedTuple):
    """A line for the operator."""

    text: str
    warns: bool


@dataclass(slots=True)
class DetectorFit:
    """What a detector takes for region in the frames of a flight."""

    frames: int = 0
    marks: int = 0
    """Number of votes for region."""
    _ayes: dict[Cell, int] = field(default_factory=dict)
    """By cell: votes for region less votes against it."""

    def note(self, event: FrameSeen) -> News | None:
        """Note a frame; return what the operator has to know, if anything."""
        self.frames += 1
        ayes = self._ayes
        for cell, positive, _ in event.votes:
            ayes[cell] = ayes.get(cell, 0) + (1 if positive else -1)
            self.marks += positive
        if self.frames != FIRST_FRAMES or not ayes:
            return None
        if self.takes_nearly_all:
            return News(
                f"the detector takes {self.share:.0%} of what the first {FIRST_FRAMES} pictures "
                f"show for region: check whether it fits this ground; {REMEDY}",
                True,
            )
        if not self.marks:
            return News(
                f"the detector takes nothing of what the first {FIRST_FRAMES} pictures show for "
                "region; the search goes on",
                False,
            )
        return None

    @property
    def cells(self) -> int:
        """Number of cells seen."""
        return len(self._ayes)

    @property
    def region(self) -> int:
        """Number of cells with a majority of votes for region."""
        return sum(ayes > 0 for ayes in self._ayes.values())

    @property
    def share(self) -> float:
        """Share of the cells seen that look like region."""
        return self.region / max(self.cells, 1)

    @property
    def takes_nearly_all(self) -> bool:
        """Whether hardly any cell is left that is not region."""
        return self.frames >= LEAST_FRAMES and self.share >= MOST_REGION


def no_verdict(state: State, fit: DetectorFit, *, real: bool) -> str:
    """Return why the map of a flight that is over shows nothing; empty where it does.

    `real`: the simulator in this process has not painted the ground.
    """
    if not state.is_over:
        return ""
    if fit.takes_nearly_all:
        return f"the detector took {fit.share:.0%} of the {fit.cells:,} cells seen for region"
    section = state.setting.mission.detector
    if real and state.completed and not state.belief.roi and is_untouched(section):
        return (
            "no region in the whole box, by the detector threshold with the values that fit the "
            "simulator's ground"
        )
    return ""


def is_untouched(section: DetectorSection) -> bool:
    """Return whether a detector is the default of a mission file, not chosen for the ground.

    >>> is_untouched(DetectorSection()), is_untouched(DetectorSection(intensity=120))
    (True, False)
    """
    default = DetectorSection()
    return section.name == default.name and default.parameters | section.parameters == (
        default.parameters
    )


# --- figures of the summary ---------------------------------------------------------------------
def doubted(values: Mapping[str, Any], cells: CellTable, setting: Setting) -> dict[str, Any]:
    """Add to a summary what the detector is not sure of: that is not mapped."""
    count = int(np.count_nonzero(cells.are("unsure")))
    area_m2 = round(count * setting.grid.cell_m**2, 1)
    found = {**values, "cells_unsure": count, "cells_unsure_m2": area_m2}
    if count:
        found["completed"], found["flown_to_the_end"] = False, values["completed"]
        found["finding"] = (
            f"{values['finding']}; {count} cells ({area_m2:,.0f} sq m) are unsure: they look like "
            "nothing that the detector was shown"
        )
    return found


def ending(values: Mapping[str, Any], no_verdict: str) -> dict[str, Any]:
    """Return the figures of a flight that ends without a verdict, as far as they are others."""
    if not no_verdict:
        return {"no_verdict": None}
    finding = f"no verdict: {no_verdict}; {values['finding']}"
    return {"completed": False, "no_verdict": no_verdict, "finding": finding}
