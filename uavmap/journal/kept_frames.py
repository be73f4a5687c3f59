"""The pictures of a flight, kept beside its journal: as they came, with the pose of each.

    frames/poses.csv     frame, vehicle, t_s, lat_deg, lon_deg, height_m, qw, qx, qy, qz, hfov_deg
    frames/1-000123.400.jpg

Times are mission seconds. The quaternion turns the camera's axes to NED (`missions.units.Pose`).
"""

from __future__ import annotations

import contextlib
import csv
import os
import shutil
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.units import LatLon, Pose, Quaternion

FRAMES: Final = "frames"
POSES: Final = "poses.csv"
COLUMNS: Final = (
    "frame", "vehicle", "t_s", "lat_deg", "lon_deg", "height_m", "qw", "qx", "qy", "qz", "hfov_deg",
)  # fmt: skip
WAITING: Final = 64
"""Maximum number of pictures that wait to be written."""
_PNG: Final = b"\x89PNG"
ROOM_MIB: Final = 64
"""Free disk space for the journal, MiB, without which the mission ends."""


class KeptFrame(NamedTuple):
    """A line of poses.csv."""

    frame: str
    vehicle: int
    t_s: float
    pose: Pose
    hfov_deg: float


class Keeper(Protocol):
    """Keeps the pictures of a flight, each just before it is judged."""

    def keep(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """Keep a picture: the original file, or pixels, blue-green-red."""


class FrameKeeper(contextlib.AbstractContextManager["FrameKeeper"]):
    """Writes pictures and their poses until the disk refuses, or has less than `ROOM_MIB` free.

    The end is reported, as are poses that cannot be read. A flight that is repeated or resumed
    keeps each picture once. `aside` writes in a thread, so that a slow disk never delays steering.
    Pictures that are too many for it are counted at the end, which waits for the rest.
    """

    def __init__(self, folder: Path, say: Callable[[str], None], *, aside: bool = False) -> None:
        self._folder = folder / FRAMES
        self._log = say
        self._over = False
        self._error = ""
        self._left_out = 0
        self._room = threading.BoundedSemaphore(WAITING)
        self._writer = ThreadPoolExecutor(1, "frames") if aside else None
        self._kept: set[str] = set()
        poses = self._folder / POSES
        try:
            if poses.is_file():
                with poses.open(encoding="utf-8", newline="") as file:
                    self._kept = {row.get("frame", "") for row in csv.DictReader(file)}
        except (OSError, UnicodeDecodeError, csv.Error):
            self._error = f"{poses} cannot be read; move {self._folder} away"
        self._log_failure()

    def keep(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        """Keep a picture: the original file, or a JPEG of the pixels. Call it from one thread."""
        self._log_failure()
        if self._over:
            return
        if self._writer is None:
            self._write(frame, picture)
            self._log_failure()
        elif self._room.acquire(blocking=False):
            self._writer.submit(self._write, frame, picture).add_done_callback(
                lambda _: self._room.release()
            )
        else:
            self._left_out += 1

    def __exit__(self, *_: object) -> None:
        if self._writer is not None:
            self._writer.shutdown()
        self._log_failure()
        if self._left_out:
            self._log(
                f"{self._left_out} pictures were not kept: {self._folder} takes them slower than "
                "the camera makes them"
            )

    def _log_failure(self) -> None:
        if self._error and not self._over:
            self._over = True
            self._log(f"pictures are kept no longer: {self._error}")

    def _write(self, frame: KeptFrame, picture: bytes | NDArray[np.uint8]) -> None:
        if self._error:
            return
        if isinstance(picture, bytes):
            data = picture
        else:
            data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
        ending = "png" if data.startswith(_PNG) else "jpg"
        name = f"{frame.vehicle}-{frame.t_s:010.3f}.{ending}"
        if name in self._kept:
            return
        path, poses = self._folder / name, self._folder / POSES
        written = 0
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            written = poses.stat().st_size if poses.exists() else 0
            if shutil.disk_usage(self._folder).free < len(data) + ROOM_MIB * 2**20:
                self._error = f"{self._folder}: less than {ROOM_MIB} MiB are left on the disk"
                return
            path.write_bytes(data)
            self._note(name, frame)
        except OSError as error:
            with contextlib.suppress(OSError):  # no incomplete picture, no incomplete line
                path.unlink(missing_ok=True)
                os.truncate(poses, written)
            self._error = f"{self._folder}: {error.strerror or error}"
            return
        self._kept.add(name)

    def _note(self, name: str, frame: KeptFrame) -> None:
        path, pose = self._folder / POSES, frame.pose
        new = not path.exists() or not path.stat().st_size
        with path.open("a", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            if new:
                writer.writerow(COLUMNS)
            place = (f"{pose.position.lat_deg:.8f}", f"{pose.position.lon_deg:.8f}")
            turn = (f"{part:.7f}" for part in pose.attitude)
            where = (*place, f"{pose.height_m:.3f}", *turn, f"{frame.hfov_deg:.4f}")
            writer.writerow((name, frame.vehicle, f"{frame.t_s:.3f}", *where))


def read_kept(folder: Path) -> Iterator[KeptFrame | str]:
    """Yield the frames of a flight's folder; a damaged line becomes a text.

    Raises `OSError` and `UnicodeDecodeError` if the file cannot be read.
    """
    with (folder / FRAMES / POSES).open(encoding="utf-8", newline="") as file:
        for number, row in enumerate(csv.DictReader(file), start=2):
            try:
                values = {key: float(row[key]) for key in COLUMNS[1:]}
                turn = Quaternion(*(values[key] for key in ("qw", "qx", "qy", "qz")))
                place = LatLon(values["lat_deg"], values["lon_deg"])
                pose = Pose(place, values["height_m"], turn)
                vehicle, t_s = int(values["vehicle"]), values["t_s"]
                yield KeptFrame(str(row["frame"]), vehicle, t_s, pose, values["hfov_deg"])
            except (KeyError, TypeError, ValueError):
                yield f"line {number} of {POSES} is damaged"
