"""What a replay tells beside its cells: the boundary at pixel level, and the ground itself."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from statistics import median

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.mission_file.schema import positions
from missions.state import Setting
from missions.units import Cell
from uavmap.offline.boundary import HALF, boundary_of
from uavmap.offline.judging import Judge
from uavmap.offline.mosaic import Tile, mosaic
from uavmap.offline.spool import Spool
from uavmap.offline.surface import Footing, Scene, Shown, Surface, fused, pitch_m
from uavmap.results.boundary import Boundary
from uavmap.results.boundary_file import BoundaryMap
from uavmap.results.view import View
from vision.raster import Raster


@dataclass(frozen=True, slots=True)
class FineMap:
    """The region at pixel level.

    Attributes:
        setting: What was to be mapped.
        scene: The used pictures over a raster.
        surface: The probabilities on it.
        boundary: The region's.
        spool: What the pictures say, and small ones of them.
        workers: How many threads.
    """

    setting: Setting
    scene: Scene
    surface: Surface
    boundary: Boundary
    spool: Spool
    workers: int

    @classmethod
    def of(
        cls, setting: Setting, judge: Judge, used: Sequence[Footing], spool: Spool, workers: int
    ) -> FineMap | None:
        """Of the used pictures; None where they show nothing."""
        if not used:
            return None
        grid, cell_m = setting.grid, setting.grid.cell_m
        scene = Scene.of(used, grid, setting.mission.ground, pitch_m(used, cell_m))
        if scene is None or not scene.shown:
            return None
        shrinks_px = int(getattr(judge.detector, "shrinks_px", 0))
        surface = fused(scene, spool, shrinks_px, workers, setting.mission.votes.positive)
        level = setting.mission.detector.share if judge.detector.calibrated else HALF
        boundary = boundary_of(surface, cell_m, level)
        return cls(setting, scene, surface, boundary, spool, workers)

    def told(
        self, t_s: float, positions_m: Sequence[float], seen: Collection[Cell], undecided: set[Cell]
    ) -> BoundaryMap:
        """What boundary.geojson tells, for the mission time of a map.

        Args:
            t_s: That time.
            positions_m: How well the place of each picture is known.
            seen: The cells on which pictures were asked.
            undecided: Those that too few of them show.
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

    def beneath(self, view: View, t_s: float) -> NDArray[np.uint8] | None:
        """The mosaic beneath a map's picture: as `uavmap.offline.mosaic.mosaic` gives it."""
        grid = self.setting.grid
        raster = Raster(
            view.left_m - grid.drift_east_m_s * t_s,
            view.top_m - grid.drift_north_m_s * t_s,
            1.0 / view.px_per_m,
            view.width_px,
            view.height_px,
        )
        tiles = (Tile(entry, self._small(entry)) for entry in self.scene.shown)
        return mosaic(raster, raster.whole, tiles, self.workers)

    def _small(self, entry: Shown) -> Callable[[], NDArray[np.uint8] | None]:
        data = self.spool.get(entry.footing.number).small  # here: the spool is no thread's business

        def decoded() -> NDArray[np.uint8] | None:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
            return upright(np.asarray(image, np.uint8), turned=entry.footing.turned)

        return decoded


def upright(image: NDArray[np.uint8], *, turned: bool) -> NDArray[np.uint8]:
    """An image the right way up, which was stored turned by 180 degrees, or not."""
    return np.ascontiguousarray(image[::-1, ::-1]) if turned else image
