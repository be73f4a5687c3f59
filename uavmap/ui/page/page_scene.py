"""What a page draws, for JSON: once the ground, the fence, the colours; then judged pictures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np

from missions.events import Vote
from missions.flight.setting import Setting
from missions.mission.schema import positions
from missions.units import LatLon
from uavmap.journal.kept_frames import KeptFrame
from uavmap.output.drawing.palette import (
    HOME_DOT,
    INK,
    LAND,
    LINES,
    RECORDED_NAMES,
    STATE_NAMES,
    TRACKS,
    css,
)
from uavmap.output.drawing.palette import STATES as COLOURS
from uavmap.output.facts.map_model import State
from uavmap.ui.page.background import Background
from vision.camera import Camera
from vision.projection import Projection

STATES: Final[tuple[State, ...]] = tuple(COLOURS)
"""The states of a cell; on a board each is told by its place in here."""


def scene_of(
    setting: Setting, background: Background | None = None, *, recorded: bool = False
) -> dict[str, Any]:
    """Return the scene of a mission, for JSON, with the picture under its map.

    Points are metres east and north in the grid's fixed frame; cells are in the moving one, which
    drifts with `drift_m_s` from mission time 0.
    """
    mission, grid = setting.mission, setting.grid

    def ring(places: Iterable[LatLon]) -> list[list[float]]:
        points = (grid.fixed(place) for place in places)
        return [[round(point.east_m, 2), round(point.north_m, 2)] for point in points]

    (home,) = ring([mission.home])
    names = RECORDED_NAMES if recorded else STATE_NAMES
    return {
        "mission": mission.name,
        "strategy": "recorded pictures" if recorded else mission.strategy,
        "vehicles": 0 if recorded else len(mission.vehicles),
        "cell_m": grid.cell_m,
        "drift_m_s": [round(grid.drift_east_m_s, 6), round(grid.drift_north_m_s, 6)],
        "home": home,
        "home_mark": [[radius_px, css(colour)] for radius_px, colour in HOME_DOT],
        "box": ring(positions(mission.search.box)),
        "fence": ring(positions(mission.fence.polygon)),
        "holes": [ring(positions(hole)) for hole in mission.fence.holes],
        "states": [[names[state], css(COLOURS[state])] for state in STATES],
        "lines": {
            key: {"name": name, "colour": css(style.colour), "dash": style.dash_px}
            for key, (name, style) in LINES.items()
            if key in ("box", "fence")
        },
        "ink": css(INK),
        "land": css(LAND),
        "background": None if background is None else background.place,
        "tracks": [css(colour) for colour in TRACKS],
    }


def marks_of(setting: Setting, frame: KeptFrame, votes: Sequence[Vote]) -> dict[str, Any]:
    """Return the verdicts of a picture, for JSON.

    `cells` holds, for each cell before the camera, its corners as eight shares of the picture's
    width and height, then 1 for region, else 0, and the share of it that looks so.
    """
    optics = setting.mission.camera.optics
    camera = Camera(math.radians(frame.hfov_deg), optics.width_px, optics.height_px)
    laid = Projection(camera, frame.pose, frame.t_s, setting.grid, setting.ground)
    corners = np.array(
        [setting.grid.corners_of(vote.cell) for vote in votes], dtype=np.float64
    ).reshape(-1, 4, 2)
    size = np.array([optics.width_px, optics.height_px], dtype=np.float64)
    parts = (laid.pixels(corners) + 0.5) / size
    cells = [
        [*(round(float(part), 4) for part in quad.ravel()), int(vote.positive), vote.share]
        for quad, vote in zip(parts, votes, strict=True)
        if np.isfinite(quad).all()
    ]
    return {"vehicle": frame.vehicle, "t_s": frame.t_s, "cells": cells}
