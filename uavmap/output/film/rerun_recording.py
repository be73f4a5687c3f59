"""A flight as a Rerun recording (.rrd): everything on one timeline, for engineers.

    /region/cells, /region/tree            the state of each cell, and the exploration tree
    /vehicles/N, /vehicles/N/track         place and track of a vehicle
    /vehicles/N/battery_wh                 its charge
    /vehicles/N/frame, .../picture         frames: pose, camera and picture
    /vehicles/N/footprint                  the ground in the frame
    /log                                   faults, and changes by the pilot or a failsafe

Lengths are metres east, north and up from the start, in the frame of the region (which may drift);
times are seconds of the mission. Needs rerun-sdk, the extra `rerun`.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from missions import events as ev
from missions.errors import OutputError
from missions.events import Event
from missions.geo.grid import Grid
from missions.units import Cell, Pose
from uavmap.base.extras import install_command
from uavmap.journal.kept_frames import FRAMES, KeptFrame, read_kept
from uavmap.output.drawing.palette import STATES, track_colour
from uavmap.output.film.film import Change, Film
from vision.camera import rotation

SUFFIX: Final = ".rrd"
SNAPSHOTS: Final = 300
"""Maximum number of complete maps in a recording."""
_LOGGED: Final = (
    ev.Crashed, ev.FrameLost, ev.GivenUp, ev.Guarded, ev.LinkLost, ev.OrderFailed, ev.Overridden,
    ev.Recalled, ev.Released, ev.Resumed,
)  # fmt: skip
_NED_TO_ENU: Final = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def sdk() -> Any:
    """Import `rerun`. Raises `OutputError` if it is not installed."""
    try:
        return importlib.import_module("rerun")
    except ImportError:
        raise OutputError(
            f"a Rerun recording needs rerun-sdk: {install_command('rerun')}"
        ) from None


class _Recording:
    def __init__(self, path: Path, title: str, grid: Grid) -> None:
        self._rr = rr = sdk()
        self._grid = grid
        self._tracks: dict[int, list[tuple[float, float, float]]] = {}
        self._stream = rr.RecordingStream("uavmap", recording_id=title)
        try:
            self._stream.save(str(path))
        except Exception as error:  # the SDK raises errors of its Rust part
            raise OutputError(f"{path}: {error}") from None
        self._stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def add_event(self, event: Event) -> None:
        rr, stream = self._rr, self._stream
        if isinstance(event, _LOGGED):
            stream.set_time("mission", duration=event.t_s)
            level = "ERROR" if isinstance(event, ev.Crashed) else "WARN"
            stream.log("/log", rr.TextLog(str(event), level=level))
        if not isinstance(event, ev.Tracked | ev.Connected):
            return
        here = self._grid.to_moving(event.position, event.t_s)
        place, path = (here.east_m, here.north_m, event.height_m), f"/vehicles/{event.vehicle}"
        self._tracks.setdefault(event.vehicle, []).append(place)
        stream.set_time("mission", duration=event.t_s)
        colour = track_colour(event.vehicle)
        stream.log(path, rr.Points3D([place], colors=[colour], radii=[0.8]))
        stream.log(f"{path}/battery_wh", rr.Scalars(event.remaining_wh))

    def add_frame(self, frame: KeptFrame, picture: bytes) -> None:
        """Add a picture with its camera and footprint, unless it is damaged."""
        rr, stream = self._rr, self._stream
        try:
            with Image.open(io.BytesIO(picture)) as opened:
                width, height = opened.size
        except OSError:
            return
        path = f"/vehicles/{frame.vehicle}/frame"
        here = self._grid.to_moving(self._grid.fixed(frame.pose.position), frame.t_s)
        place = np.array([here.east_m, here.north_m, frame.pose.height_m])
        turn = turn_enu(frame.pose)
        focal_px = 0.5 * width / math.tan(math.radians(frame.hfov_deg) / 2)
        stream.set_time("mission", duration=frame.t_s)
        stream.log(path, rr.Transform3D(translation=place, mat3x3=turn))
        camera = rr.Pinhole(
            focal_length=focal_px, width=width, height=height, image_plane_distance=3.0,
            camera_xyz=rr.ViewCoordinates.FRD,
        )  # fmt: skip
        stream.log(f"{path}/picture", camera)
        kind = "image/png" if picture.startswith(b"\x89PNG") else "image/jpeg"
        stream.log(f"{path}/picture", rr.EncodedImage(contents=picture, media_type=kind))
        corners = footprint_m(place, turn, (width / focal_px, height / focal_px))
        colour = track_colour(frame.vehicle)
        outline = [] if corners is None else [np.vstack([corners, corners[:1]])]
        stream.log(
            f"/vehicles/{frame.vehicle}/footprint", rr.LineStrips3D(outline, colors=[colour])
        )

    def finish(self, film: Film) -> None:
        rr, stream = self._rr, self._stream
        stream.reset_time()
        for number, track in sorted(self._tracks.items()):
            line = rr.LineStrips3D([track], colors=[track_colour(number)])
            stream.log(f"/vehicles/{number}/track", line, static=True)
        cell_m = self._grid.cell_m
        shown: dict[Cell, Change] = {}
        for part in moments(film.changes):
            shown.update((change.cell, change) for change in part)
            stream.set_time("mission", duration=part[-1].t)
            middles = np.array([(c.east * cell_m, c.north * cell_m, 0.0) for c in shown])
            sizes = np.tile((0.47 * cell_m, 0.47 * cell_m, 0.02), (len(shown), 1))
            boxes = rr.Boxes3D(
                centers=middles, half_sizes=sizes, fill_mode="solid",
                colors=[STATES[change.state] for change in shown.values()],
            )  # fmt: skip
            stream.log("/region/cells", boxes)
            edges = [
                [(c.east * cell_m, c.north * cell_m, 0.1) for c in (change.parent, cell)]
                for cell, change in shown.items()
                if change.parent is not None
            ]
            stream.log("/region/tree", rr.LineStrips3D(edges, colors=[(60, 60, 60)]))
        stream.flush()
        stream.disconnect()


def write_recording(
    path: Path, film: Film, events: Iterable[Event], grid: Grid, folder: Path
) -> None:
    """Write a flight as an .rrd file, with the kept frames in the folder of its results.

    Raises `OutputError` if rerun-sdk is missing or the file cannot be written.
    """
    recording = _Recording(path, film.title, grid)
    for event in events:
        recording.add_event(event)
    for frame, picture in _kept_frames(folder):
        recording.add_frame(frame, picture)
    recording.finish(film)


def _kept_frames(folder: Path) -> Iterator[tuple[KeptFrame, bytes]]:
    try:
        kept = [frame for frame in read_kept(folder) if isinstance(frame, KeptFrame)]
    except (OSError, UnicodeDecodeError):
        return
    for frame in sorted(kept, key=lambda frame: (frame.t_s, frame.vehicle)):
        with contextlib.suppress(OSError):
            yield frame, (folder / FRAMES / frame.frame).read_bytes()


def moments(changes: Sequence[Change], most: int = SNAPSHOTS) -> Iterator[list[Change]]:
    """Split the changes of a film, in order, into at most `most` parts.

    >>> [len(part) for part in moments([Change(float(t), Cell(t, 0), "non-roi", None)
    ...                                 for t in range(7)], most=3)]
    [3, 3, 1]
    """
    size = max(1, math.ceil(len(changes) / most))
    for begin in range(0, len(changes), size):
        yield list(changes[begin : begin + size])


def turn_enu(pose: Pose) -> NDArray[np.float64]:
    """Return the rotation (3 x 3) from camera axes, forward-right-down, to east, north and up.

    >>> from missions.units import LatLon, Quaternion
    >>> down = Quaternion.from_euler(0.0, -math.pi / 2, 0.0)
    >>> turn_enu(Pose(LatLon(0.0, 0.0), 10.0, down)).round(6)[:, 0].tolist()
    [0.0, 0.0, -1.0]
    """
    turned: NDArray[np.float64] = _NED_TO_ENU @ rotation(pose.attitude)
    return turned


def footprint_m(
    place: NDArray[np.float64], turn: NDArray[np.float64], spread: tuple[float, float]
) -> NDArray[np.float64] | None:
    """Return the corners of a frame on the ground, (4, 3) in m; None if one is above the horizon.

    `spread` is width and height of the picture divided by the focal length.

    >>> from missions.units import LatLon, Quaternion
    >>> down = turn_enu(Pose(LatLon(0.0, 0.0), 10.0, Quaternion.from_euler(0.0, -math.pi / 2, 0.0)))
    >>> footprint_m(np.array([0.0, 0.0, 10.0]), down, (2.0, 1.0)).round(6).tolist()[0]
    [-10.0, 5.0, 0.0]
    """
    across, along = spread[0] / 2, spread[1] / 2
    signs = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
    rays = np.array([(1.0, right * across, down * along) for right, down in signs])
    aims = rays @ turn.T
    if not (aims[:, 2] < 0.0).all():
        return None
    reach = -place[2] / aims[:, 2]
    corners: NDArray[np.float64] = place + aims * reach[:, None]
    return corners
