"""What single fields of a mission file may hold, and the tables that they are in."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetPydanticSchema,
    ValidatorFunctionWrapHandler,
)
from pydantic_core import PydanticCustomError, core_schema

# strict: "4" and true are not numbers, although Python could make some of them
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
    """A name that can be the name of a folder, on every system that people copy results to."""
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


# not a union: its messages would speak of both kinds at once
Altitude = Annotated[float | Literal["auto"], GetPydanticSchema(_altitude_schema)]


class Section(BaseModel):
    """A table of a mission file: no other keys than its own."""

    model_config = ConfigDict(extra="forbid", frozen=True)
