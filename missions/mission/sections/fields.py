"""What single fields of a mission file may hold, and the tables that they are in."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import (
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

AUTO: Final = "auto"


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
