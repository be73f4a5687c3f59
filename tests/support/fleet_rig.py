"""A field for the vehicles of a fleet."""

from __future__ import annotations

from typing import Final

from tests.support.small_missions import Points, mission_text, square

BOX: Final = square(-6.0, 14.0, 56.0, 48.0)
PADS: Final = [(0.0, 0.0), (16.0, 0.0), (32.0, 0.0), (48.0, 0.0)]
TRUE: Final = [(10.0, 30.0), (44.0, 26.0), (46.0, 44.0), (30.0, 52.0), (12.0, 46.0)]
FAR: Final = [(-4.0, 52.0), (2.0, 52.0), (2.0, 60.0), (-4.0, 60.0)]
"""Corners of another patch, for a search that finds all."""


def field_text(
    vehicles: int = 3,
    *,
    box: Points = BOX,
    region: Points = TRUE,
    high: bool = False,
    more: str = "",
) -> str:
    """Return a field with a region, and pads in a row south of it.

    `high`: with two patches, a search for all, from 30 m.
    """
    text = mission_text(
        box, square(-20.0, -14.0, 84.0, 92.0), vehicles=vehicles, homes=PADS[:vehicles],
        capacity_wh=60.0, strategy="swath", regions=[region, FAR] if high else [region],
    )  # fmt: skip
    if high:
        text = text.replace("[search]\n", '[search]\nfind = "all"\naltitude_m = 30.0\n')
    return text + more
