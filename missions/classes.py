"""Classes of a region: their names and numbers, and which of them are explored."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Final, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, model_validator

from missions.units import Cell

MAX_CLASS_NUMBER: Final = 254
"""Maximum number of a class; 0 means no region, and 255 undecided."""

ClassNumber = Annotated[int, Field(strict=True, ge=1, le=MAX_CLASS_NUMBER)]
_Micrometres = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]


class ClassShare(NamedTuple):
    """The part of a cell that is of a class, by the number of the class; 0 to 1."""

    cell: Cell
    number: int
    share: float


class RegionClass(BaseModel):
    """A class; `thickness_um` is the minimum, and the maximum unless there is no bound above."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    number: ClassNumber
    thickness_um: Annotated[tuple[_Micrometres, ...], Field(min_length=1, max_length=2)] | None = (
        None
    )

    @model_validator(mode="after")
    def _rises(self) -> RegionClass:
        if self.thickness_um is not None and list(self.thickness_um) != sorted(self.thickness_um):
            raise ValueError("thickness_um: the least comes first")
        return self


class Classes(BaseModel):
    """The classes that a detector distinguishes, by name; `region` names the explored ones.

    >>> some = Classes.model_validate({"oil": {"number": 2}, "weed": {"number": 1}})
    >>> some.names, some.explored
    ({1: 'weed', 2: 'oil'}, (1, 2))
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    __pydantic_extra__: dict[str, RegionClass] = Field(init=False)

    region: tuple[str, ...] = ()
    """Names of the explored classes; none means all of them."""

    @model_validator(mode="after")
    def _consistent(self) -> Classes:
        if not self.by_name:
            raise ValueError("no class; add one: NAME = {number = 1}")
        if len(self.names) < len(self.by_name):
            raise ValueError("two classes have the same number")
        for name in self.region:
            if name not in self.by_name:
                known = ", ".join(self.by_name)
                raise ValueError(f"region names {name!r}, which is no class: expected {known}")
        return self

    @property
    def by_name(self) -> Mapping[str, RegionClass]:
        """The classes by name."""
        return self.__pydantic_extra__

    @cached_property
    def names(self) -> Mapping[int, str]:
        """The names by number, in the order of numbers."""
        return dict(sorted((one.number, name) for name, one in self.by_name.items()))

    @cached_property
    def explored(self) -> tuple[int, ...]:
        """The numbers of the classes that are explored, rising."""
        wanted = self.region or tuple(self.by_name)
        return tuple(number for number, name in self.names.items() if name in wanted)
