"""The sections of a mission file: types of single fields, and their tables."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any, Final, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetPydanticSchema,
    SerializerFunctionWrapHandler,
    ValidatorFunctionWrapHandler,
    model_serializer,
    model_validator,
)
from pydantic_core import PydanticCustomError, core_schema
from shapely.geometry import Polygon

from missions.classes import Classes
from missions.geo.grid import Grid
from missions.geo.terrain import Relief, Terrain, decoded, relief_of
from missions.units import LatLon

# strict: "4" and true are no numbers, although Python could convert them
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True)]
Degrees = Number
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Latitude = Annotated[Number, Field(ge=-90, le=90)]
Longitude = Annotated[Number, Field(ge=-180, le=180)]
Share = Annotated[Number, Field(ge=0, le=1)]
Vertex = tuple[Latitude, Longitude]
TagDictionary = Literal[
    "DICT_4X4_50", "DICT_4X4_100", "DICT_4X4_250", "DICT_5X5_50", "DICT_5X5_100",
    "DICT_6X6_50", "DICT_APRILTAG_36h11",
]  # fmt: skip
Ring = Annotated[tuple[Vertex, ...], Field(min_length=3)]

HostName = Annotated[
    str, Field(strict=True, min_length=1, max_length=253, pattern=r"^[A-Za-z0-9._:-]+$")
]

AUTO: Final = "auto"


LONGEST_NAME: Final = 100
_RESERVED: Final = frozenset('<>:"/\\|?*')


def _file_name(name: str) -> str:
    fault = ""
    if not name or not name.strip("."):
        fault = "must not be empty or only dots"
    elif len(name) > LONGEST_NAME:
        fault = f"at most {LONGEST_NAME} letters; this has {len(name):,}"
    elif found := sorted(set(name) & _RESERVED):
        fault = f"results go into a folder of this name: leave out {' '.join(found)}"
    elif not name.isprintable():
        fault = "results go into a folder of this name: leave out control characters"
    elif name != name.strip() or name.endswith("."):
        fault = "must not begin or end with a space, or end with a dot"
    if fault:
        raise PydanticCustomError("file_name", "{fault}", {"fault": fault})
    return name


FileName = Annotated[str, AfterValidator(_file_name)]


def _number_or_auto(value: object, number: ValidatorFunctionWrapHandler) -> object:
    if isinstance(value, str) and value != AUTO:
        raise PydanticCustomError("altitude", 'must be a number or "auto"')
    return value if value == AUTO else number(value)


def _altitude_schema(_: object, schema_of: GetCoreSchemaHandler) -> core_schema.CoreSchema:
    number = schema_of.generate_schema(Annotated[Number, Field(gt=0, le=1000)])
    return core_schema.no_info_wrap_validator_function(_number_or_auto, number)


# not a union: its messages would name both types at once
Altitude = Annotated[float | Literal["auto"], GetPydanticSchema(_altitude_schema)]


class Section(BaseModel):
    """A table of a mission file, without unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)


# --- [detector] -----------------------------------------------------------------------------------
LATER: Final = "later"
"""Name in place of a detector's until one is chosen: it judges no real pictures."""
_SHARED: Final[Mapping[str, tuple[str, ...]]] = {
    "threshold": ("intensity", "dilations", "polarity"),
    "paved": ("greenness", "intensity", "dilations"),
    LATER: ("intensity", "dilations", "polarity"),
}
"""Parameters that stand in `[detector]` itself, as before there were tables."""


class DetectorSection(Section):
    """The detector of pictures, with its parameters in a table of its own: `[detector.paved]`.

    Parameters of `threshold` and `paved` may stand in `[detector]` itself, where those of both are
    one set with the defaults of the paper.
    """

    name: str = "threshold"
    model: Annotated[str | None, Field(min_length=1, max_length=4096)] = None
    """File of a model, relative to the folder of the mission file; only for detectors with a
    model."""
    model_sha256: Annotated[str | None, Field(pattern=r"^[0-9a-f]{64}$")] = None
    """SHA-256 of that file; another one is refused. Added when the mission file is read."""
    intensity: Annotated[Count, Field(ge=0, le=255)] = 150
    dilations: Annotated[Count, Field(ge=0, le=100)] = 7
    polarity: Literal["dark", "bright"] = "dark"
    greenness: Annotated[Number, Field(ge=-1, le=2)] = 0.04
    """Greenness above which the detector `paved` grows."""
    share: Annotated[Number, Field(gt=0, le=1)] = 0.3
    """Minimum share of its pixels for which a cell is seen as ROI."""
    view: Literal["cross", "all"] = "cross"
    """`cross`: a frame votes on the cell below and its four neighbours.

    `all`: it votes on every cell that it shows whole (recorded imagery from a height).
    """
    classes: Classes | None = None
    """Classes that it distinguishes; without them it knows one: the region."""
    tables: Mapping[str, Mapping[str, Any]] = {}
    """Tables of the detectors, by name; the detectors define their content."""

    @model_validator(mode="before")
    @classmethod
    def _tables(cls, value: object) -> object:
        if not isinstance(value, Mapping):
            return value
        tables = {
            key: inner
            for key, inner in value.items()
            if isinstance(inner, Mapping) and key not in cls.model_fields
        }
        rest = {key: inner for key, inner in value.items() if key not in tables}
        return {**rest, "tables": tables} if tables else rest

    @model_serializer(mode="wrap")
    def _as_written(self, fields: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return the section as it stands in a file: the detectors' tables in it."""
        values: dict[str, Any] = fields(self)
        tables: dict[str, Any] = values.pop("tables", {})
        return values | tables

    @model_validator(mode="after")
    def _one_place(self) -> DetectorSection:
        shared = _SHARED.get(self.name, ())
        for key in shared:
            if self.name in self.tables and key in self.model_fields_set:
                raise ValueError(
                    f"{key} = {getattr(self, key)!r} stands beside [detector.{self.name}]; move "
                    "it in there"
                )
        return self

    @property
    def explored(self) -> tuple[int, ...]:
        """Numbers of the explored classes; empty if it knows the region only."""
        return () if self.classes is None else self.classes.explored

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters of the named detector: those of its table, or the shared ones.

        >>> DetectorSection(name="paved", greenness=0.1).parameters
        {'greenness': 0.1, 'intensity': 150, 'dilations': 7}
        >>> DetectorSection(name="paved", paved={"greenness": 0.1}).parameters
        {'greenness': 0.1}
        """
        classes = {} if self.classes is None else {"classes": self.classes}
        if self.name in self.tables or self.name not in _SHARED:
            return {**self.tables.get(self.name, {}), **classes}
        return {key: getattr(self, key) for key in _SHARED[self.name]} | classes


# --- [terrain] ------------------------------------------------------------------------------------
MAX_POINTS = 250_000
"""Maximum number of points of a lattice: the ground in a journal stays small."""


class Lattice(Section):
    """The heights of the ground as kept with a mission (by `uavmap.load.dem`).

    They are in metres along the grid's axes around the start (`missions.geo.terrain`).
    """

    west_m: Number
    south_m: Number
    step_m: Positive
    columns: Annotated[Count, Field(ge=2, le=MAX_POINTS)]
    rows: Annotated[Count, Field(ge=2, le=MAX_POINTS)]
    heights: str

    @model_validator(mode="after")
    def _whole(self) -> Lattice:
        if self.rows * self.columns > MAX_POINTS:
            raise ValueError(f"{self.rows} x {self.columns} are more than {MAX_POINTS} heights")
        decoded(self.heights, self.rows, self.columns)
        return self


def _lattice(value: object) -> object:
    if isinstance(value, str):
        raise PydanticCustomError(
            "dem_path", "a GeoTIFF is read only beside the mission file that names it"
        )
    return value


class TerrainSection(Section):
    """The source of the heights of the ground: a digital elevation model, or the autopilot."""

    dem: Annotated[Lattice | None, BeforeValidator(_lattice)] = None
    """Lattice of the file's heights."""
    source: Literal["autopilot"] | None = None
    """Source of heights before take-off."""

    @model_validator(mode="after")
    def _one(self) -> TerrainSection:
        if (self.dem is None) == (self.source is None):
            raise ValueError('give it either dem = "FILE.tif" or source = "autopilot"')
        return self


@lru_cache(maxsize=8)
def terrain_in(lattice: Lattice) -> Terrain:
    """Return the terrain of a lattice."""
    heights = decoded(lattice.heights, lattice.rows, lattice.columns)
    heights.setflags(write=False)
    return Terrain(lattice.west_m, lattice.south_m, lattice.step_m, heights)


@lru_cache(maxsize=8)
def relief_in(lattice: Lattice, start: Vertex, fence: Ring, *, hull: bool = False) -> Relief:
    """Return the relief inside a fence; with `hull` also of the ground below straight ways in
    it."""
    grid = Grid.at(LatLon(*start), 1.0)
    ring = [grid.fixed(LatLon(*vertex)) for vertex in fence]
    area = Polygon(ring)
    return relief_of(terrain_in(lattice), area.convex_hull if hull else area)


# --- the region, and who maps it ------------------------------------------------------------------
MAX_PRIOR_PLACES = 1000


class PriorPlace(Section):
    """One of the places where the ROI may be: a point with a spread, or a polygon."""

    position: Vertex | None = None
    spread_m: Positive | None = None
    polygon: Ring | None = None
    holes: tuple[Ring, ...] = ()
    weight: Positive = 1.0

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
    """Return a single position as a list of one place."""
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
    """The box that holds at least a part of the ROI, and the probable places of the ROI in it."""

    box: Ring
    prior: Annotated[
        tuple[PriorPlace, ...],
        Field(min_length=1, max_length=MAX_PRIOR_PLACES),
        BeforeValidator(_prior_places),
    ] = ()
    """Prior: it orders the lanes so that the ROI is expected to be seen soonest."""
    find: Literal["first", "all"] = "first"
    """"first": the search ends where the ROI is seen; the patch that is connected with it is
    mapped.

    "all": the whole box is seen, and every patch of the ROI that begins in it is mapped ("swath").
    """
    altitude_m: Altitude | None = None
    """Search altitude above the start; by default that of the map.

    "auto": as high as `search.pixels_per_cell` and `fence.ceiling_m` allow.
    """
    pixels_per_cell: Positive = 20.0
    layer_m: NotNegative | None = None
    """Distance of search layers; by default `team.layer_m`. 0: one layer, where vehicles wait."""


class Votes(Section):
    """The number of frames of a cell, and of positive votes for ROI."""

    frames: Annotated[Count, Field(ge=1, le=100)] = 5
    positive: Annotated[Count, Field(ge=1, le=100)] = 3
    recorded: Literal["evidence", "count"] | None = None
    """`evidence`: weighted mean of all frames; `count`: first `frames`, as in every flight.

    By default evidence for the view "all", counting for "cross".
    """

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
    """Actions of the guardians of the aircraft when the mission is gone."""

    orphan_hold_s: Annotated[Number, Field(ge=0, le=600)] = 20.0


class Traffic(Section):
    """The distance and height of aircraft of others at which the team holds, or returns."""

    distance_m: Annotated[Number, Field(ge=0, le=20_000)] = 1000.0
    """Over ground, from any vehicle. 0: they are shown, and nothing else."""
    height_m: Annotated[Number, Field(ge=0, le=5000)] = 300.0
    """In height, above or below."""


class Team(Section):
    """The separation of several vehicles: a layer of height each."""

    separation_m: Positive = 4.0
    layer_m: Positive = 6.0
