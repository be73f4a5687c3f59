"""The region's probability at pixel level: all pictures of a replay on one raster.

    marks on the spool -> projected, weighted -> mean, block by block -> levels, compressed

No picture is decoded again. One block of the raster is in memory at a time. The pictures that show
it come from the spool one after another. Memory does not grow with the pictures, and hardly with
the ground.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from statistics import median
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from missions.flight.state import Setting
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import Pose
from uavmap.photos.ground.judging import unpacked
from uavmap.photos.scratch_file import Spool, StoredJudgement
from uavmap.photos.workers import Threads
from vision.camera import Camera
from vision.mosaic import shrunk
from vision.raster import UNSEEN, Fusion, Levels, Overlay, Raster, Window, as_levels, framed

FINEST_M: Final = 0.1
COARSEST_M: Final = 0.5
"""Limits of the edge of a pixel of the raster, m; between them it is that of the judged pictures.
"""
PIXELS_A_CELL: Final = 4
"""Minimum pixels of the raster along the edge of a cell."""
_SIDE: Final = 2048  # of a block
_MARGIN: Final = 4  # pixels around the visible ground
_WEIGHTS: Final = (0.1, 4.0)  # limits of a picture's resolution relative to the usual one


@dataclass(frozen=True, slots=True)
class Footing:
    """A used picture and its position.

    `number` is its key in the spool. `pose.height_m` is above the ground below. The grid may have
    drifted at the mission time `t_s`. `turned` is True if it is stored upside down.
    """

    number: int
    camera: Camera
    pose: Pose
    t_s: float
    turned: bool = False

    def overlay(self, grid: Grid, terrain: Terrain | None) -> Overlay:
        """Return the picture over the ground."""
        return Overlay.at_pose(self.camera, self.pose, self.t_s, grid, terrain)

    @property
    def gsd_m(self) -> float:
        """Ground sample distance straight below."""
        return self.camera.gsd_m(self.pose.height_m)


class ScenePicture(NamedTuple):
    """A picture, the corners of its possible ground, and its part of the raster."""

    footing: Footing
    overlay: Overlay
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]]
    window: Window


@dataclass(frozen=True, slots=True)
class Scene:
    """All used pictures over a raster in the grid's moving frame, in their order."""

    raster: Raster
    shown: tuple[ScenePicture, ...]

    @classmethod
    def from_footings(cls, footings: Sequence[Footing], setting: Setting) -> Scene | None:
        """Return the used pictures over a raster; None if they show no ground.

        The edge of a pixel suits them, in whole centimetres of the UTM projection. The raster's
        lines are at multiples of it.
        """
        grid = setting.grid
        bounded = [
            (footing, overlay, bounds)
            for footing in footings
            for overlay in (footing.overlay(grid, setting.mission.ground),)
            for bounds in (overlay.bounds(),)
            if bounds is not None
        ]
        if not bounded:
            return None
        low = np.min([low for _, _, (low, _) in bounded], axis=0)
        high = np.max([high for _, _, (_, high) in bounded], axis=0)
        usual_m = round(median(footing.gsd_m for footing in footings), 2)
        pitch_m = min(max(FINEST_M, min(usual_m, COARSEST_M)), grid.cell_m / PIXELS_A_CELL)
        raster = aligned(grid, low, high, pitch_m)
        entries = (ScenePicture(f, o, bounds, raster.around(*bounds)) for f, o, bounds in bounded)
        shown = tuple(entry for entry in entries if not entry.window.is_empty)
        return cls(raster, shown) if shown else None

    def blocks(self) -> Iterator[tuple[Window, list[ScenePicture]]]:
        """Yield the blocks that pictures may show, with these pictures."""
        shared = self.raster.shared((entry.window for entry in self.shown), _SIDE)
        for block, numbers in shared.items():
            yield block, [self.shown[number] for number in numbers]


def aligned(grid: Grid, low: NDArray[np.float64], high: NDArray[np.float64], step: float) -> Raster:
    """Return a raster around two corners whose lines have whole UTM coordinates, in steps."""
    origin = np.array([grid.origin.east_m, grid.origin.north_m])
    first = np.floor((origin + low * grid.scale) / step) - _MARGIN
    last = np.ceil((origin + high * grid.scale) / step) + _MARGIN
    columns, rows = (int(n) for n in last - first)
    west_m = (first[0] * step - origin[0]) / grid.scale
    north_m = (last[1] * step - origin[1]) / grid.scale
    return Raster(float(west_m), float(north_m), step / grid.scale, columns, rows)


@dataclass(slots=True)
class Surface:
    """Levels of probability over a raster, block by block; see `vision.raster`."""

    raster: Raster
    _blocks: dict[Window, bytes] = field(default_factory=dict)

    def put(self, block: Window, levels: Levels) -> None:
        """Keep a block, unless no picture shows any of it."""
        if (levels != UNSEEN).any():
            self._blocks[block] = zlib.compress(levels.tobytes(), 1)

    def blocks(self) -> Iterator[tuple[Window, Levels]]:
        """Yield every block that pictures show, with a row and a column of the next ones."""
        for block in self.raster.whole.blocks(_SIDE):
            wider = Window(block.top, block.left, block.bottom + 1, block.right + 1)
            wider = wider.common(self.raster.whole)
            near = [
                Window(top, left, top + _SIDE, left + _SIDE).common(self.raster.whole)
                for top in (block.top, block.top + _SIDE)
                for left in (block.left, block.left + _SIDE)
            ]
            if any(other in self._blocks for other in near):
                levels = np.full(wider.shape, UNSEEN, np.uint8)
                for other in near:
                    self._get(levels, wider, other)
                yield wider, levels

    def seen(self) -> Iterator[tuple[Window, Levels]]:
        """Yield every block that pictures show."""
        for block in self._blocks:
            found = np.full(block.shape, UNSEEN, np.uint8)
            self._get(found, block, block)
            yield block, found

    def _get(self, into: Levels, window: Window, block: Window) -> None:
        """Copy a block into the levels of a window, of which it has a part."""
        kept = self._blocks.get(block)
        if kept is not None:
            levels = np.frombuffer(zlib.decompress(kept), np.uint8).reshape(block.shape)
            part = block.common(window)
            into[part.within(window)] = levels[part.within(block)]


def fused(
    scene: Scene,
    spool: Spool,
    shrinks_px: int,
    threads: Threads,
    least: int,
    marks_of: Callable[[StoredJudgement], bytes] = attrgetter("marks"),
) -> Surface:
    """Fuse all pictures of a scene.

    Args:
        spool: Judgements of the pictures, by `Footing.number`.
        shrinks_px: Pixels by which the detector's mask is too small at each edge.
        threads: Threads; the result does not depend on their number.
        least: Minimum number of pictures that show a place of the result.
        marks_of: Returns the marks of a judgement that are fused, packed.
    """
    surface = Surface(scene.raster)
    usual_m = median(entry.footing.gsd_m for entry in scene.shown)

    def blocks(
        job: tuple[ScenePicture, Window, bytes],
    ) -> list[tuple[Window, Levels, NDArray[np.float32]]]:
        entry, part, marks = job
        ratio = min(max((usual_m / entry.footing.gsd_m) ** 2, _WEIGHTS[0]), _WEIGHTS[1])
        levels = framed(_levels(entry.footing, marks, shrinks_px, scene.raster.pitch_m))
        return [
            (shown, projected.sampled(levels), projected.weight)
            for shown, projected in entry.overlay.on_window(scene.raster, part, ratio)
        ]

    def jobs(
        near: Sequence[ScenePicture], around: Window
    ) -> Iterator[tuple[ScenePicture, Window, bytes]]:
        for entry in near:
            yield entry, entry.window.common(around), marks_of(spool.get(entry.footing.number))

    for block, near in scene.blocks():
        fusion = Fusion(block, least)
        for answer in threads.in_order(blocks, jobs(near, fusion.window)):
            for shown in answer:
                fusion.add(*shown)
        surface.put(block, fusion.levels())
    return surface


def _levels(footing: Footing, marks: bytes, shrinks_px: int, pitch_m: float) -> NDArray[np.uint8]:
    found = as_levels(unpacked(marks, upside_down=footing.turned), shrinks_px)
    place_m = footing.gsd_m * footing.camera.width_px / found.shape[1]
    return shrunk(found, pitch_m / place_m)
