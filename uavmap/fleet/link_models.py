"""The words of `--comms`: what a simulated radio is like, in flight and on the grid."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

RANGE: Final = "range"
_MEANT: Final = {
    "loss": "the share that is lost, such as loss:0.1",
    "delay": "a time, such as delay:0.5",
    "jitter": "a time, such as jitter:0.1",
    "rate": "how much goes through in a unit of time, such as rate:300",
}


@dataclass(frozen=True, slots=True)
class LinkWords:
    """What was said: a kind, numbers by key, and the texts of other keys as often as they came."""

    kind: str
    numbers: Mapping[str, float]
    others: tuple[tuple[str, str], ...] = ()


def link_words(
    text: str, kinds: Sequence[str], unit: str, keys: Sequence[str], others: Sequence[str] = ()
) -> LinkWords:
    """Parse `KIND[,KEY:VALUE...]`, where the kind is a name or `range:NUMBER`.

    Args:
        text: As on the command line.
        kinds: Names without a number.
        unit: Of the range, for messages.
        keys: Those with a number, each at most once: not negative, a loss at most 1, a rate above
            0. A range and a rate may be infinite.
        others: Those whose values are any text.

    Raises ValueError for anything else, with what to write.

    >>> link_words("range:200,loss:0.1", ["free"], "METRES", ["loss"]).numbers
    {'range': 200.0, 'loss': 0.1}
    >>> link_words("fre", ["free"], "METRES", ["loss"])
    Traceback (most recent call last):
    ValueError: 'fre' is none of free, range:METRES
    """
    first, *rest = text.split(",")
    kind, _, value = first.partition(":")
    numbers: dict[str, float] = {}
    kept = []
    if kind == RANGE:
        numbers[RANGE] = _number(RANGE, value, f"a distance in {unit.lower()}")
    elif first not in kinds:
        raise ValueError(f"{first!r} is none of {', '.join(kinds)}, {RANGE}:{unit}")
    for key, value in _pairs(rest):
        if key in others:
            kept.append((key, value))
        elif key not in keys:
            known = ", ".join([*keys, *others])
            raise ValueError(f"{key!r} is not known; after a comma stands one of {known}")
        elif key in numbers:
            raise ValueError(f"{key} stands there twice; leave one out")
        else:
            numbers[key] = _number(key, value, _MEANT[key])
    return LinkWords(kind, numbers, tuple(kept))


def _pairs(parts: Sequence[str]) -> Iterator[tuple[str, str]]:
    for part in parts:
        key, _, value = part.partition(":")
        yield key, value


def _number(key: str, text: str, meant: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    unbounded = key in (RANGE, "rate")
    if math.isnan(value) or (math.isinf(value) and not unbounded):
        raise ValueError(f"{key}:{text} is not a number; it is {meant}")
    if value < 0.0 or (key == "rate" and value == 0.0):
        least = "above 0" if key == "rate" else "0 or more"
        raise ValueError(f"{key}:{text} has to be {least}; it is {meant}")
    if key == "loss" and value > 1.0:
        raise ValueError(f"{key}:{text} is above 1; it is {meant}")
    return value
