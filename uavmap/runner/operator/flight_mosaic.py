"""The mosaic of a flight's pictures during the flight, in a thread that delays no frame."""

from __future__ import annotations

import math
import shutil
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from missions.flight.state import Setting
from missions.units import GridPoint
from uavmap.base import messages
from uavmap.base.image_files import decoded
from uavmap.journal.kept_frames import ROOM_MIB, KeptFrame
from uavmap.output.drawing.mosaic_file import MOSAIC, Ground, raster_of, write_mosaic
from uavmap.runner.operator.company import Onlooker
from vision.camera import Camera
from vision.growing_mosaic import GrowingMosaic
from vision.mosaic import Part, project_picture, shrunk
from vision.raster import Overlay, Raster, framed

NEAR: Final = 0.2
"""Minimum distance of two pictures of a vehicle, in heights: nearer ones show the same ground."""
WRITE_S: Final = 5.0
"""Minimum time between two writes, real seconds."""
WRITE_SHARE: Final = 0.05
"""Maximum share of the time that writing takes."""
WAITING: Final = 8
"""Maximum number of waiting pictures."""
_BEFORE: Final = 1e-9
"""Weight of a mosaic from before a resume: any new picture of a place replaces it."""


class FlightMosaic(Onlooker):
    """Writes mosaic.webp every few seconds, and at the end of a flight.

    A flight that `waits` leaves no picture out; another one leaves out those for which the thread
    is too slow. A resumed flight continues the existing mosaic. A disk that refuses is tried again;
    any other failure ends the mosaic, and nothing else. One line reports it.
    """

    def __init__(self, folder: Path, setting: Setting, *, waits: bool) -> None:
        self._folder, self._setting, self._waits = folder, setting, waits
        self._log = messages.bound("uavmap.flight")
        self._raster = raster_of(setting)
        self._mosaic: GrowingMosaic | None = None
        self._room = threading.BoundedSemaphore(WAITING)
        self._worker = ThreadPoolExecutor(1, "mosaic")
        self._last: dict[int, tuple[GridPoint, float]] = {}
        self._due_s = float("-inf")
        self._has_news = False
        """True if a picture was added since the last write."""
        self._refused = ""
        """The reason of the disk, once it has refused the file."""

    def begin(self, setting: Setting, *, again: bool) -> None:
        """Continue the existing mosaic, unless its flight is repeated."""
        if self._raster is None:
            self._log.info(f"{MOSAIC} is left out: the region drifts over the ground")
        elif not again:
            self._submit(self._go_on)

    def keep(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """Have a picture added, unless the vehicle's last one shows the same ground."""
        if self._raster is None or frame.pose.height_m <= 0.0:
            return
        place, height_m = self._setting.grid.fixed(frame.pose.position), frame.pose.height_m
        last, last_m = self._last.get(frame.vehicle, (place, math.inf))
        near = math.hypot(place.distance_to(last), height_m - last_m) < NEAR * height_m
        if near or not self._room.acquire(blocking=self._waits):
            return
        self._last[frame.vehicle] = place, height_m
        done = self._submit(self._lay, frame, picture)
        done.add_done_callback(lambda _: self._room.release())

    def end(self) -> None:
        """Lay the waiting pictures, and write; a disk that refuses gets a second chance."""
        for _ in range(2):
            self._submit(self._write)
        self._worker.shutdown()
        self._raster = None

    def _submit(self, work: Callable[..., None], *given: Any) -> Future[None]:
        return self._worker.submit(self._harmless, work, *given)

    # --- in the thread ---------------------------------------------------------------------
    def _harmless(self, work: Callable[..., None], *given: Any) -> None:
        """Do some work; a failure ends the mosaic, and nothing else."""
        if self._raster is None:
            return
        try:
            work(self._raster, *given)
        except Exception as error:
            self._raster = self._mosaic = None
            reason = f"{type(error).__name__}: {error}"
            path = self._folder / MOSAIC
            self._log.info(f"{path} is not continued ({reason}); the flight goes on")

    def _go_on(self, raster: Raster) -> None:
        ground = Ground.read(self._folder, self._setting.grid)
        if ground is not None and ground.image.shape[:2] == raster.whole.shape:
            there = ground.image[..., 3] > 0
            weight = np.where(there, np.float32(_BEFORE), np.float32(0.0))
            colours = np.ascontiguousarray(ground.image[..., 2::-1])
            self._mosaic = self._new(raster)
            self._mosaic.add(Part(raster.whole, colours, weight))

    def _new(self, raster: Raster) -> GrowingMosaic:
        return GrowingMosaic(raster.whole, len(self._setting.mission.vehicles))

    def _lay(self, raster: Raster, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        setting, height_m = self._setting, frame.pose.height_m
        image = decoded(picture, frame.frame)
        camera = Camera(math.radians(frame.hfov_deg), *image.shape[1::-1])
        overlay = Overlay.at_pose(camera, frame.pose, frame.t_s, setting.grid, setting.ground)
        bounds = overlay.bounds()
        if bounds is None:
            return
        small = framed(shrunk(image, raster.pitch_m / camera.gsd_m(height_m)))
        self._mosaic = self._mosaic or self._new(raster)
        times = setting.mission.altitude_m(0) / height_m
        window = raster.around(*bounds)
        if not window.is_empty:
            overlay = self._mosaic.aligned(overlay, raster, window, lambda: small)
        for part in project_picture(overlay, raster, window, lambda: small, times):
            self._mosaic.add(part)
            self._has_news = True
        if time.monotonic() >= self._due_s:
            self._write(raster)

    def _write(self, raster: Raster) -> None:
        begin_s = time.monotonic()
        image = self._mosaic.image() if self._mosaic is not None and self._has_news else None
        if image is None:
            return
        try:
            if shutil.disk_usage(self._folder).free < ROOM_MIB * 2**20:
                raise OSError(f"{ROOM_MIB} MiB are needed for the journal")
            write_mosaic(self._folder, image, raster, self._setting.grid)
        except OSError as error:
            if not self._refused:
                self._refused = error.strerror or str(error)
                path = self._folder / MOSAIC
                self._log.info(f"{path} cannot be written ({self._refused}); it is tried again")
        else:
            self._has_news = False
        cost_s = time.monotonic() - begin_s
        self._due_s = begin_s + max(WRITE_S, cost_s / WRITE_SHARE)
