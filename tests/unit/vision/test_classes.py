"""Detectors of several classes: the class of each pixel, and explored classes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from missions.classes import Classes
from missions.errors import ImageError, MissionFileError
from missions.geo.grid import Grid
from missions.units import LatLon, Pose, Quaternion
from tests.support.models import all_familiar
from vision.camera import Camera
from vision.detectors import Detector, make_detector
from vision.detectors.interface import judged
from vision.detectors.learned_model import ClassRule, Logistic, Model, model_bytes, read_model
from vision.detectors.onnx import OnnxSettings
from vision.projection import Frame, judge_frame

GROUND, WEED, OIL = (200, 200, 200), (60, 160, 60), (40, 40, 160)  # blue, green, red


def classes(*region: str) -> Classes:
    return Classes.model_validate({"weed": {"number": 7}, "oil": {"number": 2}, "region": region})


def color(*region: str) -> Detector:
    samples = {"weed": [WEED[::-1]], "oil": [OIL[::-1]]}
    return make_detector("color", samples=samples, classes=classes(*region), distance=15.0)


def learned(*region: str) -> Detector:
    """Return a learned model: the region is reddish or greenish, oil has red above green."""
    model = Model(
        features=("saturation", "red_green"),
        working_width_px=384,
        parts=(Logistic(mean=(0.2, 0.0), scale=(1.0, 1.0), weights=(60.0, 0.0), bias=0.0),),
        classes=ClassRule(
            numbers=(2, 7),
            mean=(0.0, 0.0),
            scale=(1.0, 1.0),
            weights=((0.0, 9.0), (0.0, -9.0)),
            bias=(0.0, 0.0),
        ),
        **all_familiar(),
    )
    assert read_model(model_bytes(model), "x") == model
    return make_detector("learned", model=model, classes=classes(*region))


def onnx(*region: str) -> Detector:
    """Return an ONNX model with the channels: neither, then (2) red, (7) green."""

    def run(batch: np.ndarray) -> np.ndarray:
        red, green, blue = batch[0]
        found = np.zeros((1, 8, *red.shape), np.float32)
        found[0, 0], found[0, 2], found[0, 7] = blue > 0.7, red > green, green > red
        return found * 20.0

    settings = OnnxSettings(tile_px=32)
    return make_detector("onnx", run=run, settings=settings, classes=classes(*region))


def picture() -> np.ndarray:
    """Return a picture of ground, weed and oil, each a third of the columns."""
    return np.hstack([np.full((96, 64, 3), colour, np.uint8) for colour in (GROUND, WEED, OIL)])


@pytest.mark.parametrize("make", [color, learned, onnx])
@pytest.mark.parametrize(
    ("region", "marked"),
    [((), {7, 2}), (("oil",), {2}), (("weed",), {7}), (("weed", "oil"), {7, 2})],
)
def test_detector_with_classes_numbers_pixels_and_marks_those_explored(
    make: Any, region: tuple[str, ...], marked: set[int]
) -> None:
    detector, image = make(*region), picture()
    found = judged(detector, image)
    assert found.classes is not None
    places = found.classes.shape[1] / image.shape[1]
    middles = (slice(16, 80), (slice(8, 56), slice(72, 120), slice(136, 184)))
    for columns, number in zip(middles[1], (0, 7, 2), strict=True):
        part = (middles[0], columns)
        judged_part = tuple(slice(int(s.start * places), int(s.stop * places)) for s in part)
        assert set(np.unique(found.classes[judged_part])) == {number}
        share = 1.0 if number in marked else 0.0
        most = 255.0 if found.marks.dtype == np.uint8 else 1.0
        assert found.marks[judged_part].mean() / most == pytest.approx(share, abs=0.02)
        assert (detector.mask(image)[part] > 0).mean() == share
        assert detector.probability(image)[part].mean() == pytest.approx(share, abs=0.1)


@pytest.mark.parametrize(
    ("params", "why"),
    [
        (
            {"samples": {"weed": [[1, 2, 3]]}, "classes": classes()},
            "each class by its name: weed, oil",
        ),
        ({"samples": [[1, 2, 3]], "classes": classes()}, "of the classes none: expected"),
        ({"samples": {"weed": [[1, 2, 3]]}}, r"\[detector.classes\] gives them"),
        ({"samples": {"weed": [], "oil": [[1, 2, 3]]}, "classes": classes()}, "samples.weed is"),
    ],
)
def test_color_samples_that_fit_no_classes_are_refused(params: dict[str, Any], why: str) -> None:
    with pytest.raises(MissionFileError, match=why):
        make_detector("color", **params)


def test_detector_of_one_class_refuses_classes() -> None:
    with pytest.raises(MissionFileError, match=r"detector\.classes is not a parameter of"):
        make_detector("threshold", classes=classes())


def test_learned_model_of_other_classes_is_refused() -> None:
    other = Classes.model_validate({"oil": {"number": 3}})
    plain = Model(
        features=("light",),
        parts=(Logistic(mean=(0.0,), scale=(1.0,), weights=(1.0,), bias=0.0),),
        **all_familiar(),
    )
    with pytest.raises(MissionFileError, match="has the numbers 3; the model distinguishes: none"):
        make_detector("learned", model=plain, classes=other)


def test_onnx_class_beyond_the_channels_is_refused() -> None:
    many = Classes.model_validate({"oil": {"number": 9}})
    detector = make_detector(
        "onnx", run=lambda batch: batch[:, :1], settings=OnnxSettings(tile_px=32), classes=many
    )
    with pytest.raises(ImageError, match="channel 9"):
        judged(detector, picture())


def test_frame_of_two_classes_gives_shares_of_each_cell() -> None:
    camera = Camera(np.radians(90.0), 192, 96)
    grid = Grid.at(LatLon(48.0, 11.0), 3.0)
    down = Quaternion.from_euler(0.0, -np.pi / 2, 0.0)
    frame = Frame(picture(), Pose(LatLon(48.0, 11.0), 9.0, down), 0.0, camera)
    verdicts = judge_frame(frame, grid, color("oil"), share=0.5, view="all")
    by_cell = {verdict.cell: verdict for verdict in verdicts}
    east = max(cell.east for cell in by_cell)
    for verdict in verdicts:
        assert verdict.share == pytest.approx(dict(verdict.classes).get(2, 0.0), abs=0.03)
        assert verdict.positive == (verdict.share >= 0.5)
    assert dict(by_cell[max(by_cell)].classes) == pytest.approx({2: 1.0})
    assert all(sum(dict(v.classes).values()) <= 1.0 + 1e-9 for v in verdicts)
    assert any(7 in dict(v.classes) and not v.positive for v in verdicts)
    assert east > 0
