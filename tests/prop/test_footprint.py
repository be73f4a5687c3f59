"""The cells that a frame judges against polygons of shapely, from rays without a homography."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely.geometry import Polygon

from missions.geo.footprint import Footprint, Optics
from missions.geo.geodesy import LocalPlane
from missions.geo.grid import Grid
from missions.units import Cell, GridPoint, LatLon
from tests.support.ground.footprints import whole_cells
from tests.unit.vision.scene import camera_axes, nadir_pose, paint
from vision.camera import Camera
from vision.detectors import make_detector
from vision.projection import OBLIQUE_LIMIT, Frame, judge_frame

FAST = settings(max_examples=80, deadline=None)
BAVARIA = LatLon(48.0, 11.9)  # grid north is 2.2 degrees off true north
PLAIN = make_detector("threshold", dilations=0)
CAMERA = Camera(math.radians(80.0), 160, 120)
NEAR_M = 0.02
"""Distance from the limit within which a cell may be in or out, m: projections differ."""

angles = st.floats(-180.0, 180.0)
metres = st.floats(-40.0, 40.0)
margins = st.sampled_from([0.0, 0.5, 1.3])


def shown(grid: Grid, over: GridPoint, height_m: float, yaw_deg: float, roll: float, pitch: float):
    """Return the polygon of ground in a picture, in the fixed frame; None with the horizon."""
    axes = camera_axes(math.radians(roll), math.radians(pitch - 90.0), math.radians(yaw_deg))
    plane = LocalPlane(grid.position(over))
    right, low = math.tan(CAMERA.hfov_rad / 2), math.tan(CAMERA.hfov_rad / 2) * 120 / 160
    corners = []
    for u, v in ((-right, -low), (right, -low), (right, low), (-right, low)):
        north, east, down = np.array([1.0, u, v]) @ axes
        if down < 0.2:
            return None
        place = plane.to_wgs84(height_m * east / down, height_m * north / down)
        corners.append(grid.fixed(place))
    return Polygon(corners)


def box(cell: Cell, cell_m: float) -> Polygon:
    e, n, h = cell.east * cell_m, cell.north * cell_m, cell_m / 2
    return shapely.box(e - h, n - h, e + h, n + h)


def whole(polygon: Polygon, cell_m: float) -> set[Cell]:
    if polygon.is_empty:
        return set()
    west, south, east, north = polygon.bounds
    return {
        cell
        for e in range(math.floor(west / cell_m), math.ceil(east / cell_m) + 1)
        for n in range(math.floor(south / cell_m), math.ceil(north / cell_m) + 1)
        if polygon.covers(box(cell := Cell(e, n), cell_m))
    }


def shrunk(polygon: Polygon, margin_m: float) -> Polygon:
    return polygon.buffer(-margin_m, join_style="mitre", mitre_limit=100.0)


@FAST
@given(
    metres, metres, st.floats(6.0, 30.0), angles, st.floats(-25, 25), st.floats(-25, 25), margins
)
def test_a_frame_judges_the_cells_wholly_inside_its_polygon_on_the_ground(
    east_m, north_m, height_m, yaw_deg, roll, pitch, margin_m
):
    grid, over = Grid.at(BAVARIA, 4.0), GridPoint(east_m, north_m)
    polygon = shown(grid, over, height_m, yaw_deg, roll, pitch)
    assume(polygon is not None)
    assume(max(math.dist(over, corner) for corner in polygon.exterior.coords) < height_m * 2.8)
    assert OBLIQUE_LIMIT > 2.8
    pose, axes = nadir_pose(grid, over, height_m, yaw_deg, (roll, pitch))
    image = paint([], grid, CAMERA, pose, axes)
    frame = Frame(image, pose, 0.0, CAMERA)
    judged = judge_frame(frame, grid, PLAIN, share=0.5, view="all", margin_m=margin_m)
    cells = [verdict.cell for verdict in judged]
    assert cells == sorted(set(cells))
    assert whole(shrunk(polygon, margin_m + NEAR_M), 4.0) <= set(cells)
    assert set(cells) <= whole(shrunk(polygon, margin_m - NEAR_M), 4.0)


@FAST
@given(metres, metres, st.floats(1.0, 60.0), st.floats(1.0, 60.0), angles, margins)
def test_the_cells_of_a_level_footprint(east_m, north_m, across_m, along_m, bearing, margin_m):
    centre = GridPoint(east_m, north_m)
    cells = whole_cells(Footprint(across_m, along_m), centre, math.radians(bearing), 4.0, margin_m)
    assert list(cells) == sorted(cells)
    cos, sin = math.cos(math.radians(bearing)), math.sin(math.radians(bearing))
    polygon = Polygon(
        (east_m + a * cos + b * sin, north_m - a * sin + b * cos)
        for a, b in (
            (-across_m / 2, -along_m / 2),
            (across_m / 2, -along_m / 2),
            (across_m / 2, along_m / 2),
            (-across_m / 2, along_m / 2),
        )
    )
    assert whole(shrunk(polygon, margin_m + 1e-3), 4.0) <= set(cells)
    assert set(cells) <= whole(shrunk(polygon, margin_m - 1e-3), 4.0)


@FAST
@given(metres, metres, st.floats(8.0, 30.0), angles, margins)
def test_cells_that_a_planner_expects_are_those_that_level_frames_judge(
    east_m, north_m, height_m, yaw_deg, margin_m
):
    grid, over = Grid.at(BAVARIA, 4.0), GridPoint(east_m, north_m)
    pose, axes = nadir_pose(grid, over, height_m, yaw_deg)
    frame = Frame(paint([], grid, CAMERA, pose, axes), pose, 0.0, CAMERA)
    judged = {
        v.cell for v in judge_frame(frame, grid, PLAIN, share=0.5, view="all", margin_m=margin_m)
    }
    bearing_rad = math.radians(yaw_deg) - grid.convergence_rad
    footprint = CAMERA.footprint(height_m)
    near, far = (
        set(whole_cells(footprint, over, bearing_rad, 4.0, margin_m + slack_m))
        for slack_m in (NEAR_M, -NEAR_M)
    )
    assert near <= judged <= far


@FAST
@given(
    st.floats(0.02, 3.1), st.integers(1, 5000), st.integers(1, 5000), st.floats(1, 400),
    st.floats(0.1, 50.0),
)  # fmt: skip
def test_height_and_pixels_of_a_cell_are_inverse(hfov_rad, width_px, height_px, height_m, cell_m):
    optics = Optics(hfov_rad, width_px, height_px)
    pixels = optics.pixels_per_cell(height_m, cell_m)
    assert optics.height_m(cell_m, pixels) == pytest.approx(height_m)
    assert optics.gsd_m(height_m) * pixels == pytest.approx(cell_m)
    across_m, along_m = optics.footprint(height_m)
    assert across_m == pytest.approx(2 * height_m * math.tan(hfov_rad / 2))
    assert along_m / across_m == pytest.approx(height_px / width_px)
