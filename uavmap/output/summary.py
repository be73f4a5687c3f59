"""The figures of a mission: summary.json, and the certificates of patches in words."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from uavmap.base.atomic_write import write_text


def encode(figures: Mapping[str, object]) -> str:
    """Encode figures as JSON, in their order; numbers that JSON lacks become null.

    Bytes of file names that are not UTF-8 are escaped; reading restores them.

    >>> print(encode({"sorties": 2, "iou_cells": float("nan")}))
    {
      "sorties": 2,
      "iou_cells": null
    }
    """
    text = json.dumps(_plain(figures), indent=2, ensure_ascii=False, allow_nan=False)
    return text.encode(errors="backslashreplace").decode()


def write(figures: Mapping[str, object], path: Path) -> None:
    """Write figures. Raises `TypeError` for values that JSON cannot hold."""
    write_text(path, encode(figures) + "\n")


def _plain(value: object) -> object:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return value


# --- patches in words -----------------------------------------------------------------------------
MAX_PATCHES: Final = 20
"""Maximum number of patches with a line each."""
_WHY: Final = {
    "beyond_fence": "beyond the fence",
    "few_frames": "in too few frames",
    "given_up": "given up",
    "no_frames": "in no frame",
    "out_of_reach": "out of reach",
    "skipped": "skipped by the operator",
}


def litres_in_words(volume_l: Sequence[float | None] | None) -> str:
    """Write the limits of a volume; empty if unknown.

    >>> litres_in_words((0.0123, 4.56)), litres_in_words([1200.0, None]), litres_in_words(None)
    ('0.0123 to 4.56 litres', '1,200 litres or more', '')
    """
    if volume_l is None:
        return ""
    low, high = (None if value is None else _three(value) for value in volume_l)
    return f"{low} litres or more" if high is None else f"{low} to {high} litres"


def _three(value: float) -> str:
    """Write three digits; for a large number, all digits before the point."""
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"


def class_lines(classes: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield a line per class of a summary.

    >>> one = {"name": "sheen", "number": 1, "cells": 3, "area_m2": 48.0, "area_low_m2": 31.0,
    ...        "area_high_m2": 60.5, "volume_l": [0.001, 0.018]}
    >>> list(class_lines([one]))
    ['sheen (class 1): 48 sq m (31 to 60), 0.001 to 0.018 litres']
    """
    for one in classes:
        area = (
            f"{one['area_m2']:,.0f} sq m ({one['area_low_m2']:,.0f} to {one['area_high_m2']:,.0f})"
        )
        litres = litres_in_words(one.get("volume_l"))
        yield f"{one['name']} (class {one['number']}): {area}" + (f", {litres}" if litres else "")


def state_in_words(one: Mapping[str, Any]) -> str:
    """Write that a patch, or all, are complete, or the number of open cells with reasons.

    >>> state_in_words({"complete": True, "open": {}})
    'complete'
    >>> state_in_words({"complete": False, "open": {"no_frames": [[0, 1], [0, 2]], "skipped": 1}})
    'open at 3 cells: 2 in no frame, 1 skipped by the operator'
    """
    if one["complete"]:
        return "complete"
    counts = {
        why: found if isinstance(found, int) else len(found) for why, found in one["open"].items()
    }
    parts = [f"{count} {_WHY[why]}" for why, count in counts.items()]
    cells = sum(counts.values())
    return f"open at {cells} {'cell' if cells == 1 else 'cells'}: {', '.join(parts)}"


def time_in_words(one: Mapping[str, Any]) -> str:
    """Write the time that was taken, and the least possible time.

    >>> time_in_words({"took_s": 73.04, "lower_bound_s": 7.3, "ratio": 10.0})
    '73.0 s, at least 7.3 s, ratio 10.00'
    >>> time_in_words({"took_s": 8.8, "lower_bound_s": 0.0, "ratio": None})
    '8.8 s, at least 0.0 s'
    """
    ratio = "" if one["ratio"] is None else f", ratio {one['ratio']:.2f}"
    return f"{one['took_s']:,.1f} s, at least {one['lower_bound_s']:,.1f} s{ratio}"


def drift_in_words(one: Mapping[str, Any]) -> str:
    """Write the measured drift of a patch, with a remedy if the mission file has another drift.

    The text is empty if the drift was not measured, or if the patch stands still as expected.

    >>> measured = {"speed_m_s": 0.301, "toward_deg": 70.4, "error_m_s": 0.01, "off_m_s": 0.002}
    >>> drift_in_words({"took_s": 400.0, "drift": {**measured, "differs": False}})
    'drifts at 0.30 m/s toward 70 deg, error 0.01 m/s'
    >>> drift_in_words({"took_s": 400.0, "drift": {**measured, "off_m_s": 0.05, "differs": True}})
    ... # doctest: +NORMALIZE_WHITESPACE
    'drifts at 0.30 m/s toward 70 deg, error 0.01 m/s; this differs by 0.05 m/s from the mission
    file: its outline may be wrong by 20 m; set drift.speed_m_s = 0.30 and drift.toward_deg = 70,
    and fly again'
    """
    drift = one.get("drift")
    if drift is None or not (drift["differs"] or drift["speed_m_s"] > 3.0 * drift["error_m_s"]):
        return ""
    speed, toward = f"{drift['speed_m_s']:.2f}", f"{drift['toward_deg']:.0f}"
    text = f"drifts at {speed} m/s toward {toward} deg, error {drift['error_m_s']:.2f} m/s"
    if not drift["differs"]:
        return text
    return (
        f"{text}; this differs by {drift['off_m_s']:.2f} m/s from the mission file: its outline "
        f"may be wrong by {drift['off_m_s'] * one['took_s']:.0f} m; set drift.speed_m_s = {speed} "
        f"and drift.toward_deg = {toward}, and fly again"
    )


def box_in_words(box: Mapping[str, Any]) -> str:
    """Write the decided part of the search box.

    >>> text = {"cells": 9, "decided": 6, "few_frames": 0, "no_frames": 2, "beyond_fence": 1}
    >>> box_in_words({**text, "whole": False})
    '6 of 9 cells decided, 2 in no frame, 1 beyond the fence'
    """
    counts = [f"{box['decided']:,} of {box['cells']:,} cells decided"]
    kinds = ("few_frames", "no_frames", "beyond_fence")
    return ", ".join([*counts, *(f"{box[why]:,} {_WHY[why]}" for why in kinds if box[why])])


def lines(
    found: Sequence[Mapping[str, Any]], in_all: Mapping[str, Any], *, verbose: bool
) -> Iterator[str]:
    """Yield a line per patch; `verbose` adds times and bounds, and lines for all and the box."""
    for number, one in enumerate(found[:MAX_PATCHES], start=1):
        root, drift = one["root"], drift_in_words(one)
        place = f"at {root['lat_deg']:.6f}, {root['lon_deg']:.6f}"
        if verbose:
            text = (
                f"; decided from {one['found_s']:,.1f} s on, {place} first, to "
                f"{one['decided_s']:,.1f} s ({time_in_words(one)})"
            )
        else:
            text = f", {place}"
        moved = f"; it {drift}" if drift else ""
        yield f"patch {number}: {one['area_m2']:,.0f} sq m, {state_in_words(one)}{text}{moved}"
    if len(found) > MAX_PATCHES:
        yield f"{len(found) - MAX_PATCHES} more patches"
    if not verbose:
        return
    if len(found) > 1:
        yield (
            f"all {len(found)} patches: {in_all['area_m2']:,.0f} sq m, {state_in_words(in_all)} "
            f"({time_in_words(in_all)})"
        )
    missed = "" if in_all["box"]["whole"] else "; a patch may be missing there"
    yield f"search box: {box_in_words(in_all['box'])}{missed}"
