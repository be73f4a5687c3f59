"""Faults of the values of a mission file, in the words of its author."""

from __future__ import annotations

import difflib
import math
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

_LONGEST_SHOWN = 60


def explain(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """Return a line for each fault of a file of this `model`: key, value and expectation.

    >>> class Wind(BaseModel, extra="forbid"):
    ...     speed_m_s: float = 0.0
    >>> try:
    ...     Wind.model_validate({"speed": 3.0})
    ... except ValidationError as error:
    ...     explain(error, Wind)
    ["speed: unknown key; did you mean 'speed_m_s'?"]
    """
    return [_describe(fault, model) for fault in _causes(error.errors())]


def _causes(faults: list[ErrorDetails]) -> list[ErrorDetails]:
    """Return the faults that follow from no other: a faulty item makes its list short."""
    places = [fault["loc"] for fault in faults]
    return [
        fault
        for fault in faults
        if fault["type"] != "too_short"
        or not any(
            len(place) > len(fault["loc"]) and place[: len(fault["loc"])] == fault["loc"]
            for place in places
        )
    ]


def _describe(fault: ErrorDetails, model: type[BaseModel]) -> str:
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in fault["loc"])
    key = key.removeprefix(".")
    if fault["type"] == "missing" and isinstance(fault["loc"][-1], int):
        return f"{key}: missing; positions are [latitude, longitude]"
    if fault["type"] == "missing":
        return f"{key}: missing; add it (see a shipped mission for an example)"
    if fault["type"] == "extra_forbidden":
        near = difflib.get_close_matches(
            str(fault["loc"][-1]), _keys_beside(fault["loc"], model), n=1
        )
        return f"{key}: unknown key" + (f"; did you mean {near[0]!r}?" if near else "")
    if fault["type"] == "too_short":
        need, has = fault["ctx"]["min_length"], fault["ctx"]["actual_length"]
        return f"{key}: {has} given, at least {need} needed"
    if fault["type"] == "model_type":
        return f"{key}: must be a table, [{key}]"
    if fault["type"] == "value_error":  # of a whole table: its message names key and value
        return f"{key}: {_lower(fault['msg'])}"
    value = fault["input"]
    if isinstance(value, str) and len(value) > _LONGEST_SHOWN:
        value = value[:_LONGEST_SHOWN] + "..."
    shown = repr(value) if isinstance(value, int | float | str | bool) else type(value).__name__
    hint = ""
    if "box" in key or "polygon" in key or "holes" in key or "position" in key or "home" in key:
        hint = " (positions are [latitude, longitude]: are they swapped?)"
        if not (isinstance(value, float | int) and math.fabs(value) > 90):
            hint = " (positions are [latitude, longitude] in degrees)"
    return f"{key} = {shown}: {_lower(fault['msg'])}{hint}"


def _lower(message: str) -> str:
    # a tuple of pydantic is a list in TOML
    message = message.removeprefix("Value error, ").replace("tuple", "list")
    return message[:1].lower() + message[1:]


def _keys_beside(loc: tuple[int | str, ...], model: type[BaseModel]) -> list[str]:
    for part in loc[:-1]:
        if part not in model.model_fields:  # a place in a list, or a name that the user chose
            continue
        found = section_of(model.model_fields[part].annotation)
        if found is None:
            return []
        model = found
    return list(model.model_fields)


def section_of(annotation: Any) -> type[BaseModel] | None:
    """Return the table that a key of this type stands for, or a list of them, if it is one."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for inner in getattr(annotation, "__args__", ()):
        if (found := section_of(inner)) is not None:
            return found
    return None
