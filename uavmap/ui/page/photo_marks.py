"""What a picture was judged to show: its cells as quadrangles of pixels, for the page to draw."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from missions.events import Vote
from missions.flight.setting import Setting
from uavmap.journal.kept_frames import KeptFrame
from uavmap.photos.ground.projection import Laid
from vision.camera import Camera


def marks_of(setting: Setting, frame: KeptFrame, votes: Sequence[Vote]) -> dict[str, Any]:
    """The verdicts of a picture, for JSON.

    `cells` holds for each cell that lies before the camera eight numbers, the pixels of its corners
    in parts of the picture's width and height, then 1 for region, else 0, and the share of it that
    looks so.
    """
    optics = setting.mission.camera.optics
    camera = Camera(math.radians(frame.hfov_deg), optics.width_px, optics.height_px)
    laid = Laid(camera, frame.pose, frame.t_s, setting.grid, setting.ground)
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
