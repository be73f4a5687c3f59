"""`judge_frame` on pictures with known content, over flat ground and over a terrain."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.errors import ImageError
from missions.geo.grid import Grid
from missions.geo.terrain import Terrain
from missions.units import Cell, GridPoint, LatLon, Pose, Quaternion
from tests.support.ground.hills import SIDE_M, STEP_M, slope
from tests.unit.vision.scene import nadir_pose, paint, square
from vision.camera import Camera, project
from vision.detectors import make_detector
from vision.projection import Frame, Projection, Verdict, judge_frame

BAVARIA = LatLon(48.0, 11.9)  # grid north is 2.2 degrees off true north
PLAIN = make_detector("threshold", dilations=0)
WIDE = Camera(math.radians(90.0), 640, 480)
SHIFTED = GridPoint(101.0, -59.5)  # over cell (25, -15), not over its centre
HERE = Cell(25, -15)


def shares(verdicts: tuple[Verdict, ...]) -> dict[Cell, float]:
    return {v.cell: v.share for v in verdicts}


@pytest.mark.parametrize("height_m", [12.0, 20.0, 40.0])
@pytest.mark.parametrize("yaw_deg", [0.0, 37.0, -100.0, 180.0])
@pytest.mark.parametrize("tilt_deg", [(0.0, 0.0), (8.0, -6.0)])
def test_painted_cells_are_positive_and_their_neighbours_are_not(
    height_m: float, yaw_deg: float, tilt_deg: tuple[float, float]
) -> None:
    grid = Grid.at(BAVARIA, height_m / 6)
    over = GridPoint(25.2 * grid.cell_m, -14.9 * grid.cell_m)
    pose, axes = nadir_pose(grid, over, height_m, yaw_deg, tilt_deg)
    painted = {HERE, Cell(25, -14), Cell(24, -15)}
    image = paint([square(grid, c) for c in painted], grid, WIDE, pose, axes)
    found = judge_frame(Frame(image, pose, 0.0, WIDE), grid, PLAIN, share=0.5, view="cross")
    assert [v.cell for v in found] == list(HERE.cross())
    assert {v.cell for v in found if v.positive} == painted
    for verdict in found:
        assert verdict.share == pytest.approx(float(verdict.cell in painted), abs=0.025)


def test_convergence_turns_the_cells() -> None:
    """A strip along the north cell's east edge: without convergence a quarter of it would slip."""
    grid = Grid.at(BAVARIA, 4.0)
    assert math.degrees(grid.convergence_rad) == pytest.approx(2.155, abs=0.01)
    pose, axes = nadir_pose(grid, GridPoint(0.0, -1.9), 12.0, 0.0)
    strip = [GridPoint(e, n) for e, n in ((1.2, 2.0), (2.0, 2.0), (2.0, 6.0), (1.2, 6.0))]
    image = paint([strip], grid, WIDE, pose, axes)
    found = judge_frame(Frame(image, pose, 0.0, WIDE), grid, PLAIN, share=0.5, view="cross")
    assert shares(found)[Cell(0, 1)] == pytest.approx(0.2, abs=0.01)
    assert shares(found)[Cell(1, 0)] == pytest.approx(0.0, abs=0.005)


@settings(max_examples=40, deadline=None)
@given(
    yaw_deg=st.floats(-180, 180),
    corners=st.lists(
        st.tuples(st.floats(-6, 6), st.floats(-6, 6)), min_size=3, max_size=3, unique=True
    ),
)
def test_turning_the_vehicle_changes_nothing(
    yaw_deg: float, corners: list[tuple[float, float]]
) -> None:
    grid = Grid.at(BAVARIA, 4.0)
    triangle = [GridPoint(100.0 + e, -60.0 + n) for e, n in corners]
    seen = []
    for yaw in (0.0, yaw_deg):
        pose, axes = nadir_pose(grid, SHIFTED, 20.0, yaw)
        image = paint([triangle], grid, WIDE, pose, axes)
        verdicts = judge_frame(Frame(image, pose, 0.0, WIDE), grid, PLAIN, share=0.5, view="cross")
        seen.append(shares(verdicts))
    assert seen[0].keys() == seen[1].keys() == set(HERE.cross())
    for cell, share in seen[0].items():
        # fillPoly paints the outline too, about a pixel of 320 / 20 a metre
        assert seen[1][cell] == pytest.approx(share, abs=0.05)


def test_the_cross_follows_the_roi_as_it_drifts() -> None:
    """0.4 m/s towards the east for 100 s: the ROI is 40 m further, ten cells."""
    grid = Grid.at(LatLon(0.0, 9.0), 4.0, drift_speed_m_s=0.4, drift_toward_deg=90.0)
    pose, axes = nadir_pose(grid, GridPoint(41.0, 0.5), 12.0, 20.0)
    painted = [square(grid, Cell(0, 0)), square(grid, Cell(1, 0))]
    image = paint(painted, grid, WIDE, pose, axes, t_s=100.0)
    found = judge_frame(Frame(image, pose, 100.0, WIDE), grid, PLAIN, share=0.5, view="cross")
    assert {v.cell for v in found if v.positive} == {Cell(0, 0), Cell(1, 0)}
    assert found[0].cell == Cell(0, 0)
    at_rest = judge_frame(Frame(image, pose, 0.0, WIDE), grid, PLAIN, share=0.5, view="cross")
    assert at_rest[0].cell == Cell(10, 0)


def test_the_centre_is_under_the_camera_not_in_the_middle_of_the_picture() -> None:
    """Tilted by 20 degrees at 12 m the middle of the picture is 4.4 m off: another cell."""
    grid = Grid.at(BAVARIA, 4.0)
    pose, axes = nadir_pose(grid, GridPoint(0.0, 0.0), 12.0, 0.0, (0.0, 20.0))
    image = paint([square(grid, Cell(0, 0))], grid, WIDE, pose, axes)
    found = judge_frame(Frame(image, pose, 0.0, WIDE), grid, PLAIN, share=0.5, view="cross")
    assert [v.cell for v in found if v.positive] == [Cell(0, 0)]
    assert found[0].cell == Cell(0, 0)


@pytest.mark.parametrize(("along_m", "judged"), [(11.1, False), (11.3, True)])
def test_a_cell_needs_nine_tenths_inside_the_picture(along_m: float, judged: bool) -> None:
    """The north cell reaches from 2 to 6 m: its first nine tenths end at 5.6 m."""
    grid = Grid.at(LatLon(0.0, 9.0), 4.0)
    camera = Camera(2 * math.atan(along_m * 4 / 3 / 24.0), 640, 480)
    assert camera.footprint(12.0)[1] == pytest.approx(along_m)
    pose, axes = nadir_pose(grid, GridPoint(0.0, 0.0), 12.0, 0.0)
    image = paint([], grid, camera, pose, axes)
    found = judge_frame(Frame(image, pose, 0.0, camera), grid, PLAIN, share=0.5, view="cross")
    east_west = [Cell(0, 0), Cell(1, 0), Cell(-1, 0)]
    assert [v.cell for v in found] == (list(Cell(0, 0).cross()) if judged else east_west)


def test_share_is_the_part_that_is_roi_and_the_limit_is_inclusive() -> None:
    """Yaw, convergence and place chosen so that half a cell is exactly half of its pixels."""
    grid = Grid.at(LatLon(0.0, 9.0), 4.0)
    camera = Camera(math.radians(90.0), 480, 480)  # 12 m up: 20 px a metre
    pose, _ = nadir_pose(grid, GridPoint(0.0, 0.0), 12.0, 0.0)
    image = np.full((480, 480, 3), 220, np.uint8)
    image[200:280, 200:240] = 60  # the west half of cell (0, 0)
    frame = Frame(image, pose, 0.0, camera)
    (at_limit, *others) = judge_frame(frame, grid, PLAIN, share=0.5, view="cross")
    assert at_limit == Verdict(Cell(0, 0), True, 0.5)
    assert all(v.share == 0.0 and not v.positive for v in others)
    assert not judge_frame(frame, grid, PLAIN, share=0.501, view="cross")[0].positive


def test_all_view_judges_every_whole_cell() -> None:
    """A picture of 80 m by 60 m with a 4 m cell at the middle shows 19 by 15 whole cells."""
    grid = Grid.at(BAVARIA, 4.0)
    camera = Camera(math.radians(90.0), 400, 300)
    aligned_deg = math.degrees(grid.convergence_rad)
    pose, axes = nadir_pose(grid, GridPoint(0.0, 0.0), 40.0, aligned_deg)
    area = [GridPoint(e, n) for e, n in ((-21.0, -7.0), (13.0, -11.0), (9.0, 17.0))]
    image = paint([area], grid, camera, pose, axes)
    found = judge_frame(Frame(image, pose, 0.0, camera), grid, PLAIN, share=0.5, view="all")
    cells = [Cell(e, n) for e in range(-9, 10) for n in range(-7, 8)]
    assert [v.cell for v in found] == cells
    (ax, ay), (bx, by), (cx, cy) = area
    area_m2 = abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay)) / 2
    assert sum(v.share for v in found) * 16.0 == pytest.approx(area_m2, rel=0.03)


@pytest.mark.parametrize("view", ["all", "cross"])
@pytest.mark.parametrize("east_m", [100.0, 145.0, 200.0, 1000.0])
def test_whole_picture_far_from_the_vantage_is_judged(
    view: Literal["all", "cross"], east_m: float
) -> None:
    grid = Grid.at(BAVARIA, 4.0)
    pose, axes = nadir_pose(grid, GridPoint(east_m, 0.0), 50.0, 0.0)
    frame = Frame(paint([], grid, WIDE, pose, axes), pose, 0.0, WIDE)
    found = judge_frame(frame, grid, PLAIN, share=0.5, view=view, vantage=Cell(0, 0))
    if view == "cross":  # the cells that it has to judge are not in the picture
        assert found == ()
    else:
        assert found == judge_frame(frame, grid, PLAIN, share=0.5, view=view)
        assert len(found) > 300


def test_cross_view_and_all_view_agree() -> None:
    grid = Grid.at(BAVARIA, 4.0)
    pose, axes = nadir_pose(grid, SHIFTED, 20.0, 70.0, (5.0, 3.0))
    triangle = [GridPoint(100.0 + e, -60.0 + n) for e, n in ((-9, -7), (8, -3), (1, 9))]
    frame = Frame(paint([triangle], grid, WIDE, pose, axes), pose, 0.0, WIDE)
    cross = shares(judge_frame(frame, grid, PLAIN, share=0.5, view="cross"))
    everything = shares(judge_frame(frame, grid, PLAIN, share=0.5, view="all"))
    assert set(cross) < set(everything)
    for cell, share in cross.items():
        assert everything[cell] == pytest.approx(share, abs=0.01)


def test_camera_that_sees_the_horizon_judges_only_ground_near_and_in_front() -> None:
    grid = Grid.at(LatLon(0.0, 9.0), 4.0)
    pose, _ = nadir_pose(grid, GridPoint(0.0, 0.0), 20.0, 0.0, (0.0, 70.0))
    frame = Frame(np.full((480, 640, 3), 60, np.uint8), pose, 0.0, WIDE)
    found = judge_frame(frame, grid, PLAIN, share=0.5, view="all")
    assert found
    assert all(v.positive for v in found)
    assert all(0 < v.cell.north <= 16 and abs(v.cell.east) <= 16 for v in found)
    behind = judge_frame(frame, grid, PLAIN, share=0.5, view="cross")
    assert [v.cell for v in behind] == []


def test_picture_from_the_ground_judges_nothing() -> None:
    grid = Grid.at(BAVARIA, 4.0)
    pose, _ = nadir_pose(grid, GridPoint(0.0, 0.0), 0.0, 0.0)
    frame = Frame(np.full((480, 640, 3), 60, np.uint8), pose, 0.0, WIDE)
    assert judge_frame(frame, grid, PLAIN, share=0.5, view="cross") == ()
    assert judge_frame(frame, grid, PLAIN, share=0.5, view="all") == ()


def test_a_picture_of_another_size_is_refused() -> None:
    grid = Grid.at(BAVARIA, 4.0)
    pose, _ = nadir_pose(grid, GridPoint(0.0, 0.0), 12.0, 0.0)
    frame = Frame(np.zeros((240, 320, 3), np.uint8), pose, 0.0, WIDE)
    with pytest.raises(ImageError, match="320 x 240"):
        judge_frame(frame, grid, PLAIN, share=0.5, view="cross")


class Halfway:
    """A detector that is sure of the painted part, and half sure of the rest."""

    name = "halfway"
    calibrated = True

    def probability(self, image: np.ndarray) -> np.ndarray:
        return np.where(PLAIN.mask(image) > 0, np.float32(1.0), np.float32(0.5))

    def mask(self, image: np.ndarray) -> np.ndarray:
        raise AssertionError("a calibrated detector is asked for its probability")


@pytest.mark.parametrize("level", [None, Terrain(-500.0, -500.0, 1000.0, np.zeros((2, 2)))])
def test_a_calibrated_cell_has_the_mean_probability(level: Terrain | None) -> None:
    grid = Grid.at(BAVARIA, 4.0)
    pose, axes = nadir_pose(grid, GridPoint(0.0, 0.0), 12.0, 20.0)
    image = paint([square(grid, Cell(0, 0))], grid, WIDE, pose, axes)
    frame = Frame(image, pose, 0.0, WIDE)
    found = judge_frame(frame, grid, Halfway(), share=0.75, view="cross", terrain=level)
    plain = judge_frame(frame, grid, PLAIN, share=0.5, view="cross", terrain=level)
    assert [v.cell for v in found] == [v.cell for v in plain]
    assert [v.positive for v in found] == [v.positive for v in plain]
    for verdict, sure in zip(found, plain, strict=True):
        # a probability is sampled between pixels, a mask at the nearest one
        assert verdict.share == pytest.approx(0.5 + 0.5 * sure.share, abs=2e-3)


HILLS = LatLon(48.0, 11.3)
HILLY = Grid.at(HILLS, 4.0)
NARROW = Camera(math.radians(80.0), 320, 240)


def terrain(percent, toward_deg=0.0):
    return Terrain(-SIDE_M, -SIDE_M, STEP_M, slope(percent, toward_deg))


def pose(roll_deg=0.0, pitch_deg=0.0, yaw_deg=20.0, height_m=14.0):
    body = [math.radians(angle) for angle in (roll_deg, pitch_deg - 90.0, yaw_deg)]
    return Pose(HILLS, height_m, Quaternion.from_euler(*body))


def test_projection_over_level_ground_is_the_homography():
    at = pose(4.0, 6.0)
    flat = Projection(NARROW, at, 0.0, HILLY, terrain(0.0))
    points = np.array([[0.0, 0.0], [3.0, -5.0], [-8.0, 2.0]])
    matrix = NARROW.homography(at, HILLY, 0.0)
    for reported, wanted in zip(flat.project(points), project(matrix, points), strict=True):
        assert reported == pytest.approx(wanted)
    picture = np.full((240, 320, 3), 60, np.uint8)
    picture[:, 170:] = 200
    frame = Frame(picture, at, 0.0, NARROW)
    detector = make_detector("threshold", intensity=150, dilations=0, polarity="dark")
    for view in ("cross", "all"):
        known = judge_frame(frame, HILLY, detector, share=0.3, view=view, margin_m=0.3)
        found = judge_frame(
            frame, HILLY, detector, share=0.3, view=view, margin_m=0.3, terrain=terrain(0.0)
        )
        shares = {v.cell: v.share for v in found}
        if view == "cross":
            assert [v.cell for v in known] == list(shares)
        common = [v for v in known if v.cell in shares]
        assert len(common) >= 0.9 * len(known)
        assert [shares[v.cell] for v in common] == pytest.approx(
            [v.share for v in common], abs=0.04
        )


def test_a_point_uphill_is_farther_out_in_the_picture():
    at = pose(yaw_deg=0.0)  # the upper edge is north
    uphill = Projection(NARROW, at, 0.0, HILLY, terrain(20.0, 0.0))
    pixels, depth = uphill.project(np.array([[0.0, 5.0], [0.0, -5.0]]))
    focal = NARROW.focal_px
    assert depth == pytest.approx([13.0, 15.0])
    assert pixels[:, 1] == pytest.approx(
        [119.5 - focal * 5.0 / 13.0, 119.5 + focal * 5.0 / 15.0], abs=0.6
    )


def test_fewer_cells_are_shown_whole_uphill_than_downhill():
    seen = Projection(NARROW, pose(yaw_deg=0.0), 0.0, HILLY, terrain(30.0, 0.0))
    rows = seen.cells("all", 0.2)[:, 1]
    assert rows.max() < -rows.min()
