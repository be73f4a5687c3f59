"""summary.json: the figures of a mission, for people and programs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

from uavmap.base.atomic_write import write_text


def encode(figures: Mapping[str, object]) -> str:
    """The figures as JSON, in the order given; numbers that JSON lacks become null.

    A name of a file that is no UTF-8 comes in the escapes of JSON, and reads back as it was.

    >>> print(encode({"sorties": 2, "iou_cells": float("nan")}))
    {
      "sorties": 2,
      "iou_cells": null
    }
    """
    text = json.dumps(_plain(figures), indent=2, ensure_ascii=False, allow_nan=False)
    return text.encode(errors="backslashreplace").decode()


def write(figures: Mapping[str, object], path: Path) -> None:
    """Write the figures to `path`. Raises `TypeError` for what JSON cannot hold."""
    write_text(path, encode(figures) + "\n")


def _plain(value: object) -> object:
    """The value with null for every NaN and infinity in it."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return value
