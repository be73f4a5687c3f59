"""The fit of a flight's detector to the ground, from the journal.

A flight ends without a verdict if its detector marks nearly all ground. It also does if the
detector marks no ground and was not chosen for this ground.
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
MIN_FRAMES: Final = 20
"""Minimum number of frames for a statement about the detector."""
MAX_REGION_SHARE: Final = 0.9
"""Minimum share of observed cells with a majority for region at which the detector hardly fits."""
REMEDY: Final = (
    "check what it marks (`uavmap look`), and choose another one or train it (`uavmap tune`)"
)


class Notice(NamedTuple):
    """A line for the operator."""

    text: str
    warns: bool


@dataclass(slots=True)
class DetectorFit:
    """The votes of a detector in the frames of a flight."""

    frames: int = 0
    marks: int = 0
    """Number of votes for region."""
    _ayes: dict[Cell, int] = field(default_factory=dict)
    """Votes for region minus votes against it, by cell."""

    def note(self, event: FrameSeen) -> Notice | None:
        """Note a frame; return a line for the operator, if there is one."""
        self.frames += 1
        ayes = self._ayes
        for cell, positive, _ in event.votes:
            ayes[cell] = ayes.get(cell, 0) + (1 if positive else -1)
            self.marks += positive
        if self.frames != FIRST_FRAMES or not ayes:
            return None
        if self.marks_nearly_all:
            return Notice(
                f"the detector marks {self.share:.0%} of the ground in the first {FIRST_FRAMES} "
                f"pictures as region: check whether it fits this ground; {REMEDY}",
                True,
            )
        if not self.marks:
            return Notice(
                f"the detector marks no region in the first {FIRST_FRAMES} pictures; the search "
                "goes on",
                False,
            )
        return None

    @property
    def cells(self) -> int:
        """Number of observed cells."""
        return len(self._ayes)

    @property
    def region(self) -> int:
        """Number of cells with a majority of votes for region."""
        return sum(ayes > 0 for ayes in self._ayes.values())

    @property
    def share(self) -> float:
        """Share of the observed cells with a majority of votes for region."""
        return self.region / max(self.cells, 1)

    @property
    def marks_nearly_all(self) -> bool:
        """Return whether nearly all observed cells have a majority for region."""
        return self.frames >= MIN_FRAMES and self.share >= MAX_REGION_SHARE


def no_verdict(state: State, fit: DetectorFit, *, real: bool) -> str:
    """Return why a finished flight has no verdict; empty if it has one.

    `real`: true unless the simulator of this process painted the ground.
    """
    if not state.is_over:
        return ""
    if fit.marks_nearly_all:
        return f"the detector marked {fit.share:.0%} of the {fit.cells:,} observed cells as region"
    section = state.setting.mission.detector
    if real and state.completed and not state.belief.roi and is_untouched(section):
        return (
            "no region in the whole box, by the detector threshold with the values that fit the "
            "simulator's ground"
        )
    return ""


def is_untouched(section: DetectorSection) -> bool:
    """Return whether a detector is the unchanged default of a mission file.

    >>> is_untouched(DetectorSection()), is_untouched(DetectorSection(intensity=120))
    (True, False)
    """
    default = DetectorSection()
    return section.name == default.name and default.parameters | section.parameters == (
        default.parameters
    )


# --- figures of the summary ---------------------------------------------------------------------
def with_unsure(values: Mapping[str, Any], cells: CellTable, setting: Setting) -> dict[str, Any]:
    """Add the cells to a summary of which the detector is unsure: they are not mapped."""
    count = int(np.count_nonzero(cells.in_state("unsure")))
    area_m2 = round(count * setting.grid.cell_m**2, 1)
    found = {**values, "cells_unsure": count, "cells_unsure_m2": area_m2}
    if count:
        found["completed"], found["flown_to_the_end"] = False, values["completed"]
        found["finding"] = (
            f"{values['finding']}; {count} cells ({area_m2:,.0f} sq m) are unsure: unlike what the "
            "detector knows"
        )
    return found


def ending(values: Mapping[str, Any], no_verdict: str) -> dict[str, Any]:
    """Return the figures that differ for a flight that ends without a verdict."""
    if not no_verdict:
        return {"no_verdict": None}
    finding = f"no verdict: {no_verdict}; {values['finding']}"
    return {"completed": False, "no_verdict": no_verdict, "finding": finding}
