"""Recorded imagery through the same `look` and `step` as a flight.

    photographs -> frames -> look(frame, grid, detector) -> FrameSeen -> step -> map

A folder of photographs is taken as one look over the whole area: under the view "all" they count as
taken from one vantage, and the first `votes.frames` that show a cell decide on it
(`missions.mapping.belief`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from missions.errors import ImageError
from missions.events import Event, FrameLost, FrameSeen, Tracked
from missions.state import Setting, State
from missions.step import step
from missions.units import Cell, GridPoint
from uavmap.fly.classifier import Classifier
from uavmap.fly.progress import Progress
from uavmap.offline.above_ground import above_ground
from uavmap.offline.photos import Photo, list_photos
from uavmap.pictures import read_image
from uavmap.record.journal import Journal
from uavmap.results.write_results import write_results
from vision.camera import Camera
from vision.look import Frame
from vision.upright import upside_down

VEHICLE: Final = 1

WHOLE_AREA: Final = Cell(0, 0)
"""The vantage of all photographs: one look over the whole area, named by the grid's first cell."""


def replay(
    images: Path, setting: Setting, journal: Journal, folder: Path, progress: Progress
) -> dict[str, Any]:
    """Map what the photographs show; returns the summary.

    Raises `ImageError` for a photograph without a geotag and for one that cannot be decoded.
    """
    photos = list_photos(images)
    progress.begin(setting, again=False)
    frames = []
    for number, photo in enumerate(photos, start=1):
        frames.append(_frame(photo, setting))
        progress.say(f"read {number} of {len(photos)}: {photo.path.name}")
    frames = _upright(frames, photos, setting, progress)
    classifier = Classifier.of(setting.mission, setting.grid)
    state = State.initial(setting)
    outside = 0
    for number, (photo, frame) in enumerate(zip(photos, frames, strict=True), start=1):
        point = setting.grid.fixed(photo.pose.position)
        outside += not setting.fence.contains(point)
        place = GridPoint(round(point.east_m, 2), round(point.north_m, 2))
        # photographs of one second still are different frames
        t_s = round(photo.taken_s + 1e-3 * number, 3)
        seen = _judged(classifier, frame, t_s)
        if isinstance(seen, FrameLost):
            progress.say(f"{photo.path.name}: {seen.reason}; not judged")
        elif not seen.votes:
            progress.say(f"{photo.path.name}: shows no cell whole; not judged")
        events: list[Event] = [
            Tracked(VEHICLE, t_s, place, round(photo.pose.height_m, 2), 0.0),
            seen,
        ]
        for event in events:
            journal.append(event)
            state, _ = step(setting, state, event)
    progress.end()
    if outside:
        progress.say(f"{outside} of {len(photos)} photographs were taken outside of the fence")
    return write_results(folder, setting, list(journal.events()), None, recorded=len(photos))


def _judged(classifier: Classifier, frame: Frame, t_s: float) -> FrameSeen | FrameLost:
    """What a photograph says, or why it says nothing."""
    whole = classifier.mission.detector.view == "all"
    try:
        vantage, votes = classifier.votes(frame, WHOLE_AREA if whole else None)
    except ImageError as error:
        return FrameLost(VEHICLE, t_s, str(error))
    return FrameSeen(VEHICLE, t_s, vantage, votes)


def _frame(photo: Photo, setting: Setting) -> Frame:
    """A photograph at the size that the mission works with."""
    image = read_image(photo.path.read_bytes(), str(photo.path))
    section = setting.mission.camera
    scale = min(section.width_px / photo.width_px, 1.0)
    if scale < 1.0:
        size = (round(photo.width_px * scale), round(photo.height_px * scale))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    hfov_rad = photo.hfov_rad or math.radians(section.hfov_deg)
    camera = Camera(hfov_rad, image.shape[1], image.shape[0])
    return Frame(image, above_ground(photo.pose, setting), photo.taken_s, camera)


def _upright(
    frames: list[Frame], photos: list[Photo], setting: Setting, progress: Progress
) -> list[Frame]:
    """Turn back what a picture viewer has turned by 180 degrees, and say so."""
    upright = []
    for frame, photo, turned in zip(frames, photos, upside_down(frames, setting.grid), strict=True):
        if turned:
            progress.say(
                f"{photo.path.name}: stored upside down (it overlaps its neighbours only when "
                "turned by 180 degrees); turned"
            )
            frame = replace(frame, image=np.ascontiguousarray(frame.image[::-1, ::-1]))
        upright.append(frame)
    return upright
