"""The region's probability at pixel level: all pictures of a replay on one raster.

    marks on the spool -> laid on the ground, weighted -> mean, block by block -> levels, compressed

No picture is decoded again. One block of the raster is in memory at a time; the pictures that show
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
from uavmap.photos.scratch_file import Said, Spool
from uavmap.photos.workers import Threads
from vision.camera import Camera
from vision.mosaic import shrunk
from vision.raster import UNSEEN, Fusion, Levels, Overlay, Raster, Window, as_levels, framed

FINEST_M: Final = 0.1
COARSEST_M: Final = 0.5
"""Limits of the edge of a pixel of the raster, m; between them it is that of the judged pictures.
"""
PIXELS_A_CELL: Final = 4
"""Least pixels of the raster along the edge of a cell."""
_SIDE: Final = 2048  # of a block
_MARGIN: Final = 4  # pixels around all that is shown
_WEIGHTS: Final = (0.1, 4.0)  # of a picture's resolution beside the usual


@dataclass(frozen=True, slots=True)
class Footing:
    """A used picture and where it was taken.

    `number` is its key in the spool; `pose.height_m` is above the ground below; at the mission time
    `t_s` the grid may have drifted; `turned` is stored upside down.
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


class Shown(NamedTuple):
    """A picture, the corners of what it may show, and its part of the raster."""

    footing: Footing
    overlay: Overlay
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]]
    window: Window


@dataclass(frozen=True, slots=True)
class Scene:
    """All used pictures over a raster in the grid's moving frame, in their order."""

    raster: Raster
    shown: tuple[Shown, ...]

    @classmethod
    def of(cls, footings: Sequence[Footing], setting: Setting) -> Scene | None:
        """Return the used pictures over a raster; None where they show nothing.

        The edge of a pixel suits them, in centimetres of the UTM projection; the raster's lines lie
        at multiples of it.
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
        entries = (Shown(f, o, bounds, raster.around(*bounds)) for f, o, bounds in bounded)
        shown = tuple(entry for entry in entries if not entry.window.is_empty)
        return cls(raster, shown) if shown else None

    def blocks(self) -> Iterator[tuple[Window, list[Shown]]]:
        """Yield the blocks of which pictures may show something, with these."""
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
        """Keep a block, unless nothing was seen there."""
        if (levels != UNSEEN).any():
            self._blocks[block] = zlib.compress(levels.tobytes(), 1)

    def blocks(self) -> Iterator[tuple[Window, Levels]]:
        """Yield every block with something seen, with a row and a column of the next ones."""
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
        """Yield every block of which something was seen."""
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
    marks_of: Callable[[Said], bytes] = attrgetter("marks"),
) -> Surface:
    """Fuse all pictures of a scene.

    Args:
        spool: Their judgements, by `Footing.number`.
        shrinks_px: Pixels by which the detector's mask is too small at each edge.
        threads: The result does not depend on their count.
        least: Least pictures of a place that counts as seen.
        marks_of: The marks of a judgement that are fused, packed.
    """
    surface = Surface(scene.raster)
    usual_m = median(entry.footing.gsd_m for entry in scene.shown)

    def said(job: tuple[Shown, Window, bytes]) -> list[tuple[Window, Levels, NDArray[np.float32]]]:
        entry, part, marks = job
        ratio = min(max((usual_m / entry.footing.gsd_m) ** 2, _WEIGHTS[0]), _WEIGHTS[1])
        levels = framed(_levels(entry.footing, marks, shrinks_px, scene.raster.pitch_m))
        return [
            (shown, projected.sampled(levels), projected.weight)
            for shown, projected in entry.overlay.on_window(scene.raster, part, ratio)
        ]

    def jobs(near: Sequence[Shown], around: Window) -> Iterator[tuple[Shown, Window, bytes]]:
        for entry in near:
            yield entry, entry.window.common(around), marks_of(spool.get(entry.footing.number))

    for block, near in scene.blocks():
        fusion = Fusion(block, least)
        for answer in threads.in_order(said, jobs(near, fusion.window)):
            for shown in answer:
                fusion.add(*shown)
        surface.put(block, fusion.levels())
    return surface


def _levels(footing: Footing, marks: bytes, shrinks_px: int, pitch_m: float) -> NDArray[np.uint8]:
    camera = footing.camera
    found = as_levels(
        unpacked(marks, camera.height_px, camera.width_px, upside_down=footing.turned), shrinks_px
    )
    return shrunk(found, pitch_m / footing.gsd_m)
