"""Familiarity of pixels: densities, and the kind of each pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from missions.geo.grid import Grid
from missions.units import GridPoint, LatLon
from tests.support.models import all_familiar
from tests.unit.vision.scene import nadir_pose
from vision.camera import Camera
from vision.detectors.familiarity import NAMES, QUANTILES, Comparison, Familiar, Gaussian, Kind
from vision.detectors.interface import Judgement
from vision.detectors.learned_model import LearnedDetector, Logistic, Model
from vision.projection import Frame, judge_frame

SIDE = len(NAMES)
DENSITIES = tuple(-20.0 + number for number in range(len(QUANTILES)))


def gaussian(mean: float, spread: float, weight: float = 1.0) -> Gaussian:
    whitening = tuple(map(tuple, (np.eye(SIDE) / spread).tolist()))
    return Gaussian(weight=weight, mean=(mean,) * SIDE, whitening=whitening)


def comparison(*parts: Gaussian) -> Comparison:
    scaled = (np.full(SIDE, 0.5, np.float32), np.full(SIDE, 2.0, np.float32))
    return Comparison(Kind(gaussians=parts, densities=DENSITIES), *scaled)


def test_density_is_that_of_a_normal_distribution_but_for_a_constant() -> None:
    values = np.random.default_rng(2).normal(size=(SIDE, 50)).astype(np.float32)
    found = comparison(gaussian(0.2, 0.7)).density(values)
    standardised = (values.T - 0.5) / 2.0
    expected = multivariate_normal(np.full(SIDE, 0.2), 0.49 * np.eye(SIDE)).logpdf(standardised)
    away = found - expected
    assert np.ptp(away) < 1e-3
    assert away[0] == pytest.approx(SIDE / 2 * np.log(2 * np.pi), abs=1e-3)


def test_place_is_compared_with_the_kind_that_it_is_taken_for() -> None:
    familiar = Familiar(comparison(gaussian(0.0, 0.5)), comparison(gaussian(3.0, 0.5)))
    place = np.full((SIDE, 2), 6.5, np.float32)  # 3.0 when standardised
    taken = familiar.familiarity(place, np.array([True, False]))
    assert taken[0] == 0.0
    assert taken[1] > 0.9


@dataclass(frozen=True)
class HalfBlind:
    """A detector that takes all for region, and is familiar with the left half only."""

    name: ClassVar[str] = "half blind"
    calibrated: ClassVar[bool] = True

    def probability(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        return np.ones(image.shape[:2], np.float32)

    def mask(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return np.full(image.shape[:2], 255, np.uint8)

    def judged(self, image: NDArray[np.uint8]) -> Judgement:
        known = self.probability(image)
        known[:, known.shape[1] // 2 :] = 0.0
        return Judgement(known, known)


def test_cell_of_unfamiliar_pixels_is_unsure_and_no_region() -> None:
    grid = Grid.at(LatLon(48.0, 11.0), 4.0)
    camera = Camera(1.4, 320, 240)
    pose, _ = nadir_pose(grid, GridPoint(0.0, 0.0), 20.0, 0.0)
    frame = Frame(np.zeros((240, 320, 3), np.uint8), pose, 0.0, camera)
    verdicts = judge_frame(frame, grid, HalfBlind(), share=0.3, view="all")
    assert {v.unsure for v in verdicts if v.cell.east < 0} == {False}
    assert {v.unsure for v in verdicts if v.cell.east > 0} == {True}
    assert {v.positive for v in verdicts if v.cell.east < 0} == {True}
    assert {v.positive for v in verdicts if v.cell.east > 0} == {False}


@pytest.mark.parametrize(("densities", "marked"), [(-1e9, 1.0), (1e9, 0.0)])
def test_unfamiliar_pixels_have_a_probability_and_do_not_count_as_region(
    densities: float, marked: float
) -> None:
    fields = all_familiar()
    rising = tuple(densities + number for number in range(len(QUANTILES)))
    kind = fields["familiarity"].region.model_copy(update={"densities": rising})
    fields["familiarity"] = fields["familiarity"].model_copy(
        update={"region": kind, "surround": kind}
    )
    sure = Logistic(mean=(0.0,), scale=(1.0,), weights=(0.0,), bias=5.0)
    detector = LearnedDetector(Model(features=("light",), parts=(sure,), **fields))
    picture = np.full((64, 96, 3), 90, np.uint8)
    assert (np.asarray(detector.judged(picture).marks) > 0).mean() == marked
    assert detector.probability(picture).min() > 0.9
