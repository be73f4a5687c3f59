"""Tables of a mission file on the region: where it is searched, by what team, and its votes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from missions.mission.sections.fields import (
    Altitude,
    Count,
    Degrees,
    NotNegative,
    Number,
    Positive,
    Ring,
    Section,
    Vertex,
)

MAX_PRIOR_PLACES = 1000


class PriorPlace(Section):
    """One of the places where the ROI may be: a point with a spread, or a polygon."""

    position: Vertex | None = None
    spread_m: Positive | None = None
    """Standard deviation around `position`; without it half of the box's shorter side."""
    polygon: Ring | None = None
    holes: tuple[Ring, ...] = ()
    """Of the polygon."""
    weight: Positive = 1.0
    """How probable it is, beside the other places."""

    @model_validator(mode="after")
    def _one_shape(self) -> PriorPlace:
        if (self.position is None) == (self.polygon is None):
            raise ValueError("give it either a position or a polygon")
        if self.polygon is not None and self.spread_m is not None:
            raise ValueError("spread_m belongs to a position; a polygon is as wide as it is")
        if self.polygon is None and self.holes:
            raise ValueError("holes belong to a polygon")
        return self


def _prior_places(value: object) -> object:
    """A single position is a list of one place."""
    if isinstance(value, str):
        raise PydanticCustomError(
            "prior_path",
            "a GeoJSON file is read only beside the mission file that names it; write the places "
            "here: [latitude, longitude], or [{{position = [...]}}, {{polygon = [...]}}]",
        )
    if isinstance(value, list | tuple) and len(value) == 2:
        numbers = [isinstance(part, int | float) for part in value]
        return [{"position": value}] if all(numbers) else value
    return value


class Search(Section):
    """The box that holds at least a part of the ROI, and where in it the ROI probably is."""

    box: Ring
    prior: Annotated[
        tuple[PriorPlace, ...],
        Field(min_length=1, max_length=MAX_PRIOR_PLACES),
        BeforeValidator(_prior_places),
    ] = ()
    """Orders the lanes so that the ROI is expected to be seen soonest. Without it they are flown
    one beside the other."""
    find: Literal["first", "all"] = "first"
    """"first": the search ends where the ROI is seen first, and what hangs together with that is
    mapped. "all": the whole box is seen, and every patch of the ROI that begins in it is mapped
    (strategy "swath")."""
    altitude_m: Altitude | None = None
    """Of the lowest layer of the search, above the start; without it that of the map. "auto": as
    high as `search.pixels_per_cell` and `fence.ceiling_m` allow."""
    pixels_per_cell: Positive = 20.0
    """What the edge of a cell must have for a suspicion, where the search has layers of its own."""
    layer_m: NotNegative | None = None
    """Height between two layers of the search; without it `team.layer_m`. 0: all search in one, as
    high as any of them; who would come near another one waits."""


class Votes(Section):
    """How many frames a cell gets, and how many of them must say yes."""

    frames: Annotated[Count, Field(ge=1, le=100)] = 5
    positive: Annotated[Count, Field(ge=1, le=100)] = 3
    recorded: Literal["evidence", "count"] | None = None
    """How recorded pictures decide on a cell. `evidence`: by the mean of what all of them saw,
    weighed; `count`: by the first `frames`, as in the paper and in every flight. Left out: by
    evidence under the view "all", by counting under "cross"."""

    @model_validator(mode="after")
    def _enough_frames(self) -> Votes:
        if self.positive > self.frames:
            raise ValueError(
                f"positive = {self.positive} can never be reached with frames = {self.frames}"
            )
        return self


class Wind(Section):
    """The worst wind known for the flight."""

    speed_m_s: Annotated[Number, Field(ge=0, le=40)] = 0.0
    from_deg: Degrees = 0.0


class Drift(Section):
    """A rigid translation of the ROI, known beforehand (section 3)."""

    speed_m_s: Annotated[Number, Field(ge=0, le=20)] = 0.0
    toward_deg: Degrees = 0.0


class Guardian(Section):
    """What the guardians of the aircraft do when the mission is gone."""

    orphan_hold_s: Annotated[Number, Field(ge=0, le=600)] = 20.0


class Team(Section):
    """How several vehicles keep apart: a layer of height each."""

    separation_m: Positive = 4.0
    """Two airborne vehicles are never nearer than this."""
    layer_m: Positive = 6.0
    """Height between two layers; more than `separation_m`, for what the vehicles waver."""
