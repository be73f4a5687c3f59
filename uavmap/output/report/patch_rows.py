"""The certificates of patches, as a report tells them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from uavmap.output.facts.flown_mission import Flown
from uavmap.output.facts.patch_summary import MOST_PATCHES, box_in_words, state_in_words


class PatchRow(NamedTuple):
    """A patch, or all of them, as the page tells it; seconds are those after lift-off."""

    name: str
    area: str
    first_cell: str
    first_s: str
    last_s: str
    took_s: str
    least_s: str
    ratio: str
    drift: str
    state: str


def patch_rows(flown: Flown) -> tuple[list[PatchRow], int]:
    """A row a patch, one for all where there are several; and how many patches have none.

    None of a replay, whose pictures nobody has flown for.
    """
    if flown.recorded:
        return [], 0
    found, in_all = flown.values["patches"], flown.values["patches_in_all"]
    rows = [_row(str(number), one) for number, one in enumerate(found[:MOST_PATCHES], start=1)]
    if len(found) > 1:
        rows.append(_row("all", in_all))
    return rows, max(0, len(found) - MOST_PATCHES)


def box_told(flown: Flown) -> str:
    """How much of the search box is decided, and what follows; empty of a replay."""
    if flown.recorded:
        return ""
    box = flown.values["patches_in_all"]["box"]
    proof = "no patch that begins in it is missing, if the verdicts are right"
    return f"{box_in_words(box)}: {proof if box['whole'] else 'a patch may be missing there'}"


def _row(name: str, one: Mapping[str, Any]) -> PatchRow:
    root = one.get("root")
    return PatchRow(
        name,
        f"{one['area_m2']:,.0f}",
        "" if root is None else f"{root['lat_deg']:.6f}, {root['lon_deg']:.6f}",
        f"{one['found_s']:,.1f}",
        f"{one['decided_s']:,.1f}",
        f"{one['took_s']:,.1f}",
        f"{one['lower_bound_s']:,.1f}",
        "" if one["ratio"] is None else f"{one['ratio']:.2f}",
        _drift(one.get("drift")),
        state_in_words(one),
    )


def _drift(drift: Mapping[str, Any] | None) -> str:
    """As it was measured, marked where the mission says otherwise."""
    if drift is None:
        return ""
    told = f"{drift['speed_m_s']:.2f} toward {drift['toward_deg']:.0f}°"
    told += f" ± {drift['error_m_s']:.2f}"
    return f"{told}, not as the mission says" if drift["differs"] else told
