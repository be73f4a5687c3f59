"""A replay's results beside its cells: the boundary at pixel level, and the ground itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.flight.setting import Setting
from missions.geo.grid import Grid
from missions.mission.schema import positions
from uavmap.output.drawing.scene import View
from uavmap.output.facts.boundary_file import BoundaryMap
from uavmap.output.facts.boundary_model import Boundary
from uavmap.photos.ground.judging import Judge
from uavmap.photos.ground.pixel_boundary import HALF, boundary_of
from uavmap.photos.ground.surface import Footing, Scene, Shown, Surface, fused, pitch_m
from uavmap.photos.scratch_file import Spool
from uavmap.photos.workers import GoOn, in_order
from vision.overlay import framed
from vision.raster import Raster, Window

SHARPNESS: Final = 2
"""Number of times that weights are squared: the best picture shows, the others hardly."""

_ROWS: Final = 256

Colours = NDArray[np.uint8]


class Tile(NamedTuple):
    """A picture of a mosaic.

    `shown.window` is of another raster and not used. `image` returns blue-green-red, of any size,
    `framed`; None if it cannot be read; any thread may call it.
    """

    shown: Shown
    image: Callable[[], Colours | None]


def mosaic(raster: Raster, window: Window, tiles: Iterable[Tile], workers: int) -> Colours | None:
    """Return a window of a mosaic; None where no picture shows anything of it.

    Where pictures overlap the one that looks down most steeply shows; each fades into the next.

    Args:
        raster: In the grid's moving frame.
        tiles: The pictures that may show something of the window.

    Returns:
        Shape (rows, columns, 4), uint8: red, green, blue, and 255 where there is a picture, else 0.
    """
    colours = np.zeros((*window.shape, 3), np.float32)
    total = np.zeros(window.shape, np.float32)

    def laid(tile: Tile) -> list[tuple[Window, Colours, NDArray[np.float32]]]:
        part = raster.around(*tile.shown.bounds).common(window)
        found, image = [], None
        for at, laying in () if part.is_empty else tile.shown.overlay.laid(raster, part):
            image = tile.image() if image is None else image
            if image is None:
                break
            weight = laying.weight
            for _ in range(SHARPNESS):
                weight = weight * weight
            found.append((at, laying.sampled(image), weight))
        return found

    for answer in in_order(laid, tiles, workers):
        for part, image, weight in answer:
            at = part.within(window)
            shades = cv2.multiply(image, cv2.merge([weight] * 3), dtype=cv2.CV_32F)
            for summed, more in ((colours, shades), (total, weight)):
                cv2.add(summed[at], more, dst=summed[at])
    return _means(colours, total)


def _means(colours: NDArray[np.float32], total: NDArray[np.float32]) -> Colours | None:
    """Return colours' sums over weights; some rows at a time, to save memory."""
    if not cv2.hasNonZero(total):
        return None
    found = np.empty((*total.shape, 4), np.uint8)
    for top in range(0, len(total), _ROWS):
        weight, into = total[top : top + _ROWS], found[top : top + _ROWS]
        mean = cv2.divide(colours[top : top + _ROWS], cv2.merge([weight] * 3))  # 0 where none is
        blue, green, red = cv2.split(cv2.convertScaleAbs(mean))
        there = (weight > 0.0).view(np.uint8) * np.uint8(255)
        cv2.merge([red, green, blue, there], dst=into)
    return found


@dataclass(frozen=True, slots=True)
class FineMap:
    """The region at pixel level: its pictures over a raster, probabilities, boundary."""

    setting: Setting
    scene: Scene
    surface: Surface
    boundary: Boundary

    @classmethod
    def of(
        cls,
        setting: Setting,
        judge: Judge,
        scene: Scene,
        spool: Spool,
        workers: int,
        go_on: GoOn = lambda: None,
    ) -> FineMap:
        """Make it of the pictures of a scene; `go_on` is called before each picture."""
        shrinks_px = int(getattr(judge.detector, "shrinks_px", 0))
        surface = fused(scene, spool, shrinks_px, workers, setting.mission.votes.positive, go_on)
        level = setting.mission.detector.share if judge.detector.calibrated else HALF
        boundary = boundary_of(surface, setting.grid.cell_m, level)
        return cls(setting, scene, surface, boundary)

    def told(
        self,
        t_s: float,
        positions_m: Sequence[float],
        seen: NDArray[np.int32],
        undecided: NDArray[np.int32],
    ) -> BoundaryMap:
        """Return the content of boundary.geojson.

        Args:
            positions_m: Standard deviation of each picture's position.
            seen: The examined cells, sorted; shape (n, 2).
            undecided: Those that too few pictures show.
        """
        mission = self.setting.mission
        return BoundaryMap(
            mission.name,
            self.setting.grid,
            t_s,
            mission.home,
            positions(mission.search.box),
            self.boundary,
            median(positions_m),
            seen,
            undecided,
        )


def scene_of(setting: Setting, used: Sequence[Footing]) -> Scene | None:
    """Return the used pictures over a raster; None where they show nothing."""
    if not used:
        return None
    grid = setting.grid
    scene = Scene.of(used, grid, setting.mission.ground, pitch_m(used, grid.cell_m))
    return None if scene is None or not scene.shown else scene


def beneath(
    scene: Scene, spool: Spool, grid: Grid, workers: int, t_s: float
) -> Callable[[View], NDArray[np.uint8] | None]:
    """Return the mosaic beneath a map's picture, as `mosaic` gives it."""

    def laid(view: View) -> NDArray[np.uint8] | None:
        raster = Raster(
            view.left_m - grid.drift_east_m_s * t_s,
            view.top_m - grid.drift_north_m_s * t_s,
            1.0 / view.px_per_m,
            view.width_px,
            view.height_px,
        )
        tiles = (Tile(entry, _small(entry, spool)) for entry in scene.shown)
        return mosaic(raster, raster.whole, tiles, workers)

    return laid


def _small(entry: Shown, spool: Spool) -> Callable[[], NDArray[np.uint8] | None]:
    data = spool.get(entry.footing.number).small

    def decoded() -> NDArray[np.uint8] | None:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        return framed(upright(np.asarray(image, np.uint8), turned=entry.footing.turned))

    return decoded


def upright(image: NDArray[np.uint8], *, turned: bool) -> NDArray[np.uint8]:
    """Return an image the right way up that may be stored turned by 180 degrees."""
    return np.ascontiguousarray(image[::-1, ::-1]) if turned else image
