"""The section of a mission file that says how pictures are judged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from missions.mission.sections.fields import Count, Number, Section

_SHARED: Final[Mapping[str, tuple[str, ...]]] = {
    "threshold": ("intensity", "dilations", "polarity"),
    "paved": ("greenness", "intensity", "dilations"),
}
"""The parameters that stand in `[detector]` itself, as before there were tables."""


class DetectorSection(Section):
    """Which detector judges pictures, and its parameters, in a table of its own:
    `[detector.paved]`.

    Parameters of `threshold` and `paved` may stand in `[detector]` itself, where those of both are
    one set with the defaults of the paper.
    """

    name: str = "threshold"
    model: Annotated[str | None, Field(min_length=1, max_length=4096)] = None
    """The file of a model, of the detectors that have one: from the folder of the mission file."""
    model_sha256: Annotated[str | None, Field(pattern=r"^[0-9a-f]{64}$")] = None
    """Of that file; another one is refused. Added when the mission file is read."""
    intensity: Annotated[Count, Field(ge=0, le=255)] = 150
    dilations: Annotated[Count, Field(ge=0, le=100)] = 7
    polarity: Literal["dark", "bright"] = "dark"
    greenness: Annotated[Number, Field(ge=-1, le=2)] = 0.04
    """Of the detector `paved`: what is greener than this grows."""
    share: Annotated[Number, Field(gt=0, le=1)] = 0.3
    """A cell is seen as ROI from this share of its pixels on."""
    view: Literal["cross", "all"] = "cross"
    """`cross`: a frame votes on the cell below and its four neighbours; `all`: on every cell
    that it shows whole (recorded imagery from a height)."""
    tables: Mapping[str, Mapping[str, Any]] = {}
    """The tables of the detectors, by name; what may be in them, the detectors say."""

    @model_validator(mode="before")
    @classmethod
    def _tables(cls, value: object) -> object:
        """A table in this section is one of a detector."""
        if not isinstance(value, Mapping):
            return value
        tables = {key: inner for key, inner in value.items() if isinstance(inner, Mapping)}
        rest = {key: inner for key, inner in value.items() if key not in tables}
        return {**rest, "tables": tables} if tables else rest

    @model_serializer(mode="wrap")
    def _as_written(self, fields: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """The section as it stands in a file: the detectors' tables in it."""
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
    def parameters(self) -> dict[str, Any]:
        """The parameters of the named detector: those of its table, or the shared ones.

        >>> DetectorSection(name="paved", greenness=0.1).parameters
        {'greenness': 0.1, 'intensity': 150, 'dilations': 7}
        >>> DetectorSection(name="paved", paved={"greenness": 0.1}).parameters
        {'greenness': 0.1}
        """
        if self.name in self.tables or self.name not in _SHARED:
            return dict(self.tables.get(self.name, {}))
        return {key: getattr(self, key) for key in _SHARED[self.name]}
