"""summary.json: the figures of a mission, for people and programs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

from uavmap.base.atomic_write import write_text


def encode(figures: Mapping[str, object]) -> str:
    """Encode figures as JSON, in their order; numbers that JSON lacks become null.

    Bytes of file names that are not UTF-8 are escaped, and read back as they were.

    >>> print(encode({"sorties": 2, "iou_cells": float("nan")}))
    {
      "sorties": 2,
      "iou_cells": null
    }
    """
    text = json.dumps(_plain(figures), indent=2, ensure_ascii=False, allow_nan=False)
    return text.encode(errors="backslashreplace").decode()


def write(figures: Mapping[str, object], path: Path) -> None:
    """Write figures. Raises `TypeError` for what JSON cannot hold."""
    write_text(path, encode(figures) + "\n")


def _plain(value: object) -> object:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return value
