"""A replay's results besides its cells: the boundary at pixel level, and the mosaic.

    Surface -> lines of P = 0.1, a level between, 0.9 -> polygons with holes -> simplified

Coordinates are ground metres of the grid's moving frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiLineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from missions.flight.state import Setting
from missions.geo.grid import Grid
from missions.mission.schema import positions
from uavmap.output.drawing.mosaic_file import raster_of, write_mosaic
from uavmap.output.drawing.scene import View
from uavmap.output.facts.boundary_file import Boundary, BoundaryMap, Line
from uavmap.photos.ground.judging import Judge, class_mask
from uavmap.photos.ground.surface import Scene, ScenePicture, Surface, fused
from uavmap.photos.scratch_file import Spool
from uavmap.photos.workers import Threads
from vision.contours import Contours, Ring
from vision.mosaic import Colours, Mosaic, Part, project_picture
from vision.raster import MOST, Raster, Window, framed

HALF: Final = 0.5
"""Probability at the boundary, unless a calibrated detector decides cells at another."""
LOW: Final = 0.1
HIGH: Final = 0.9
TOLERANCE: Final = 0.5
"""Maximum error of simplified lines, pixels of the raster."""
MIN_PART: Final = 0.5
"""Minimum size of a part of the region, or of a hole in it, in cells."""
_APART: Final = 0.05  # between the level of the boundary and those of its band


def boundary_of(surface: Surface, cell_m: float, level: float = HALF) -> Boundary:
    """Return the lines where P is `level`, without parts and holes below `MIN_PART`."""
    level = min(max(level, LOW + _APART), HIGH - _APART)
    raster, least_m2 = surface.raster, MIN_PART * cell_m**2
    contours = {p: Contours(p * MOST - 0.5, raster.columns) for p in (LOW, level, HIGH)}
    for window, levels in surface.blocks():
        for lines in contours.values():
            lines.add(levels, window.top, window.left)
    rings = {p: list(lines.rings(least_m2 / raster.pitch_m**2)) for p, lines in contours.items()}
    shapes = {p: _polygons(raster, found) for p, found in rings.items()}
    pieces = np.asarray(shapely.linestrings(_open_parts(raster, rings[level])), object)
    open_lines = shapely.line_merge(MultiLineString(list(pieces)))
    return Boundary(
        level,
        shapes[level],
        shapes[HIGH],
        shapes[LOW],
        _many(shapely.difference(shapes[LOW], shapes[HIGH])),
        _lines(shapes[level], shapes[LOW], shapes[HIGH], raster.pitch_m),
        shapely.simplify(open_lines, TOLERANCE * raster.pitch_m),
        raster.pitch_m,
        TOLERANCE * raster.pitch_m,
    )


def _ground(raster: Raster, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return metres east and north of columns and rows."""
    east = raster.west_m + (points[:, 0] + 0.5) * raster.pitch_m
    north = raster.north_m - (points[:, 1] + 0.5) * raster.pitch_m
    return np.column_stack([east, north])


def _polygons(raster: Raster, rings: Sequence[Ring]) -> MultiPolygon:
    """Return polygons of rings, each hole in the smallest ring around it."""
    outer = [r for r in rings if r.area_px > 0.0]
    holes = [r for r in rings if r.area_px < 0.0]
    shells = [Polygon(_ground(raster, ring.points)) for ring in outer]
    owned: list[list[NDArray[np.float64]]] = [[] for _ in shells]
    if holes and shells:
        first = shapely.points([_ground(raster, ring.points)[0] for ring in holes])
        found = shapely.STRtree(shells).query(first, predicate="within")
        around: dict[int, int] = {}
        for hole, shell in found.T.tolist():
            best = around.get(hole)
            if best is None or outer[shell].area_px < outer[best].area_px:
                around[hole] = shell
        for hole, shell in around.items():
            owned[shell].append(_ground(raster, holes[hole].points))
    parts = [Polygon(shell.exterior, inner) for shell, inner in zip(shells, owned, strict=True)]
    return _many(_simplified(MultiPolygon(parts), TOLERANCE * raster.pitch_m))


def _simplified(shape: MultiPolygon, tolerance_m: float) -> BaseGeometry:
    """Return the shape with fewer points: line by line, or slower if those lines cross."""
    quick = shapely.simplify(shape, tolerance_m, preserve_topology=False)
    return quick if quick.is_valid else shapely.simplify(shape, tolerance_m)


def _many(shape: BaseGeometry) -> MultiPolygon:
    """Return a shape's polygons: valid, with area, outer rings counter-clockwise."""
    if not shape.is_valid:
        shape = shapely.make_valid(shape)
    parts = [p for p in shapely.get_parts(shape) if p.geom_type == "Polygon" and p.area > 0.0]
    many = shapely.orient_polygons(MultiPolygon(parts))
    assert isinstance(many, MultiPolygon)
    return many


def _lines(
    region: MultiPolygon, low: MultiPolygon, high: MultiPolygon, pitch_m: float
) -> tuple[Line, ...]:
    """Return the region's lines, each point with half the distance from P = 0.1 to P = 0.9."""
    shells = [(part.exterior, False) for part in region.geoms]
    holes = [(ring, True) for part in region.geoms for ring in part.interiors]
    rings = [(shapely.get_coordinates(ring), hole) for ring, hole in (*shells, *holes)]
    if not rings:
        return ()
    points = np.concatenate([ring[:-1] for ring, _ in rings])
    ways = [_distances(points, shape) for shape in (low, high)]
    half = 0.5 * np.maximum(np.add(*ways), pitch_m)
    parts = np.split(half, np.cumsum([len(ring) - 1 for ring, _ in rings])[:-1])
    return tuple(Line(ring, hole, part) for (ring, hole), part in zip(rings, parts, strict=True))


def _distances(points: NDArray[np.float64], shape: MultiPolygon) -> NDArray[np.float64]:
    """Return the distance of each point from the edge of a shape; infinite if there is none."""
    found = np.full(len(points), np.inf)
    edges = [
        np.asarray(shapely.linestrings(np.stack([ring[:-1], ring[1:]], axis=1)), object)
        for part in shape.geoms
        for line in (part.exterior, *part.interiors)
        for ring in (shapely.get_coordinates(line),)
    ]
    if edges:
        tree = shapely.STRtree(np.concatenate(edges))
        (at, _), away = tree.query_nearest(
            shapely.points(points), return_distance=True, all_matches=False
        )
        found[at] = away
    return found


def _open_parts(raster: Raster, rings: Sequence[Ring]) -> NDArray[np.float64]:
    """Return pieces of rings along ground without pictures, shape (n, 2, 2), two points each."""
    pieces = [np.zeros((0, 2, 2))]
    for ring in rings:
        both = ring.open & np.roll(ring.open, -1)
        points = _ground(raster, ring.points)
        pieces.append(np.stack([points, np.roll(points, -1, axis=0)], axis=1)[both])
    return np.concatenate(pieces)


# --- the ground, and all of it -------------------------------------------------------------------
class Tile(NamedTuple):
    """A picture of a mosaic.

    `shown.window` is of another raster and not used. `image` returns blue-green-red, of any size,
    `framed`; None if it cannot be read. Any thread may call it.
    """

    shown: ScenePicture
    image: Callable[[], Colours | None]


def mosaic(
    raster: Raster, window: Window, tiles: Iterable[Tile], threads: Threads
) -> Colours | None:
    """Return a window of a mosaic; None if no picture shows any of it.

    The steepest view of a place shows; each picture fades into the next.

    Args:
        raster: A raster in the grid's moving frame.
        tiles: The pictures that may show something of the window.

    Returns:
        Shape (rows, columns, 4), uint8: red, green, blue, and 255 where there is a picture, else 0.
    """
    found = Mosaic(window)

    def parts(tile: Tile) -> list[Part]:
        part = raster.around(*tile.shown.bounds).common(window)
        return project_picture(tile.shown.overlay, raster, part, tile.image)

    for answer in threads.in_order(parts, tiles):
        for part in answer:
            found.add(part)
    return found.image()


@dataclass(frozen=True, slots=True)
class FineMap:
    """The region at pixel level: its pictures over a raster, probabilities, boundary."""

    setting: Setting
    scene: Scene
    surface: Surface
    boundary: Boundary
    classes: Mapping[str, Boundary]
    """Boundary of each class of the region, by name."""

    @classmethod
    def from_scene(
        cls,
        setting: Setting,
        judge: Judge,
        scene: Scene,
        spool: Spool,
        threads: Threads,
    ) -> FineMap:
        """Make it from the pictures of a scene."""
        shrinks_px = int(getattr(judge.detector, "shrinks_px", 0))
        surface = fused(scene, spool, shrinks_px, threads, setting.mission.votes.positive)
        level = setting.mission.detector.share if judge.detector.calibrated else HALF
        boundary = boundary_of(surface, setting.grid.cell_m, level)
        section, least = setting.mission.detector, setting.mission.votes.positive

        def of_class(number: int) -> Boundary:
            marks = partial(class_mask, number=number)
            found = fused(scene, spool, shrinks_px, threads, least, marks)
            return boundary_of(found, setting.grid.cell_m)

        names = {} if section.classes is None else section.classes.names
        classes = {names[number]: of_class(number) for number in section.explored}
        return cls(setting, scene, surface, boundary, classes)

    def boundary_map(
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
            undecided: Those with too few pictures.
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
            self.classes,
        )


def beneath(
    scene: Scene, spool: Spool, grid: Grid, threads: Threads, t_s: float
) -> Callable[[View], NDArray[np.uint8] | None]:
    """Return the mosaic behind a map's picture, as `mosaic` returns it."""

    def draw(view: View) -> NDArray[np.uint8] | None:
        raster = Raster(
            view.left_m - grid.drift_east_m_s * t_s,
            view.top_m - grid.drift_north_m_s * t_s,
            1.0 / view.px_per_m,
            view.width_px,
            view.height_px,
        )
        tiles = (Tile(entry, _small(entry, spool)) for entry in scene.shown)
        return mosaic(raster, raster.whole, tiles, threads)

    return draw


def write_ground(
    folder: Path, scene: Scene, spool: Spool, setting: Setting, threads: Threads
) -> None:
    """Write mosaic.webp as a flight does; not of a region that drifts over the ground."""
    raster = raster_of(setting)
    if raster is None:
        return
    tiles = (Tile(entry, _small(entry, spool)) for entry in scene.shown)
    image = mosaic(raster, raster.whole, tiles, threads)
    if image is not None:
        write_mosaic(folder, image, raster, setting.grid)


def _small(entry: ScenePicture, spool: Spool) -> Callable[[], NDArray[np.uint8] | None]:
    data = spool.get(entry.footing.number).small

    def decoded() -> NDArray[np.uint8] | None:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        return framed(upright(np.asarray(image, np.uint8), turned=entry.footing.turned))

    return decoded


def upright(image: NDArray[np.uint8], *, turned: bool) -> NDArray[np.uint8]:
    """Return an image the right way up, turned by 180 degrees if it is stored so."""
    return np.ascontiguousarray(image[::-1, ::-1]) if turned else image
