"""The classifier of a vehicle: vantages, and pictures that are no evidence."""

import numpy as np
import pytest

from missions.errors import ImageError
from missions.geo.grid import Grid
from missions.units import Cell, GridPoint
from tests.support.ground.footprints import whole_cells
from tests.support.small_missions import CELL_M, START, mission, square
from tests.unit.vision.scene import nadir_pose
from uavmap.aircraft.imaging.classifier import Classifier
from vision.projection import Frame

GRID = Grid.at(START, CELL_M)
MADE = mission(square(0, 0, 40, 30), square(-30, -30, 120, 100))


def classifier(made=MADE):
    return Classifier.for_mission(made, GRID)


def seeing_all(*, noiseless=False):
    return MADE.model_copy(
        update={
            "detector": MADE.detector.model_copy(update={"view": "all", "dilations": 0}),
            "camera": MADE.camera.model_copy(update={"noiseless": noiseless}),
        }
    )


def frame(east_m=0.0, height_m=12.0, *, level=60.0, seed=1):
    pose, _ = nadir_pose(GRID, GridPoint(east_m, 0.0), height_m, 0.0)
    camera = classifier().camera
    noise = np.random.default_rng(seed).normal(level, 4.0, (camera.height_px, camera.width_px, 3))
    return Frame(np.clip(noise, 0, 255).astype(np.uint8), pose, 0.0, camera)


def flat(level):
    pose, _ = nadir_pose(GRID, GridPoint(0.0, 0.0), 12.0, 0.0)
    camera = classifier().camera
    image = np.full((camera.height_px, camera.width_px, 3), level, np.uint8)
    return Frame(image, pose, 0.0, camera)


def test_vantage_is_the_cell_below_unless_one_is_given():
    vantage, votes = classifier().votes(frame(east_m=9.0), None)
    assert vantage == Cell(2, 0)
    assert {vote.cell for vote in votes} == set(vantage.cross())
    vantage, votes = classifier().votes(frame(east_m=9.0), Cell(1, 0))
    assert vantage == Cell(1, 0)
    assert {vote.cell for vote in votes} <= set(vantage.cross())
    assert votes


def test_frame_from_anywhere_judges_every_cell_shown_whole():
    """From 12 m the picture shows 20.1 m x 15.1 m; the outer half metre is left out."""
    here = classifier()
    east_m = 9.3
    seen = frame(east_m=east_m)
    votes = here.votes_anywhere(seen)
    footprint = here.camera.footprint(12.0)
    margin_m = here.mission.camera.pose_error_m
    assert margin_m == 0.5
    place = here.grid.to_moving(here.grid.fixed(seen.pose.position), seen.t_s)
    expected = whole_cells(footprint, place, -here.grid.convergence_rad, 4.0, margin_m)
    assert [vote.cell for vote in votes] == list(expected)
    assert len(votes) > 5
    with pytest.raises(ImageError, match="repeats"):  # no evidence here either
        here.votes_anywhere(seen)


@pytest.mark.parametrize("east_m", [0.0, 100.0, 145.0, 200.0, 1000.0])
def test_recorded_frame_is_judged_by_its_pose_at_any_vantage(east_m):
    """All photographs of a replay have one vantage; each judges the ground that it shows."""
    vantage, votes = classifier(seeing_all()).votes(frame(east_m, 50.0), Cell(0, 0))
    assert vantage == Cell(0, 0)
    at_start = classifier(seeing_all()).votes(frame(0.0, 50.0), Cell(0, 0))[1]
    assert len(votes) == pytest.approx(len(at_start), rel=0.1)
    mean_m = np.mean([vote.cell.east * CELL_M for vote in votes])
    assert mean_m == pytest.approx(east_m, abs=CELL_M)
    assert all(vote.positive for vote in votes)


@pytest.mark.parametrize("level", [0, 128, 255])
def test_picture_without_content_is_an_error(level):
    with pytest.raises(ImageError, match="picture is"):
        classifier().votes(flat(level), None)


def test_stalled_camera_is_an_error_until_a_new_picture():
    judge = classifier()
    judge.votes(frame(seed=1), None)
    for _ in range(3):
        with pytest.raises(ImageError, match="stalled"):
            judge.votes(frame(seed=1), None)
    assert judge.votes(frame(seed=2), None)[1]


def test_refused_picture_is_remembered():
    judge = classifier()
    judge.votes(frame(seed=1), None)
    with pytest.raises(ImageError):
        judge.votes(flat(0), None)
    assert judge.votes(frame(seed=1), None)[1]  # the new picture differs from the last one


def test_simulated_camera_without_noise_may_repeat():
    judge = classifier(seeing_all(noiseless=True))
    assert judge.votes(flat(128), None) == judge.votes(flat(128), None)
    with pytest.raises(ImageError, match="dark"):
        judge.votes(flat(0), None)
