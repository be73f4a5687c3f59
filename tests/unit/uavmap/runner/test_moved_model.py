"""A flight whose detector's model is no longer where it was when the flight began."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from missions.errors import ImageError, MissionFileError
from missions.flight.setting_of import setting_of
from missions.mission.sections.detector_section import DetectorSection
from tests.support.flights import small_mission
from tests.support.said import Said
from uavmap.aircraft.imaging.classifier import Blind
from uavmap.aircraft.imaging.judge import PictureJudge
from uavmap.runner.vehicles import judge_of


def judge(model: Path, *, recall: bool) -> PictureJudge:
    section = DetectorSection(name="learned", model=str(model), model_sha256="0" * 64)
    made = small_mission().model_copy(update={"detector": section})
    return judge_of(setting_of(made), recall=recall)


@pytest.mark.parametrize("there", [False, True])
def test_without_its_model_a_flight_can_be_called_home_and_no_more(
    tmp_path: Path, there: bool, said: Said
) -> None:
    model = tmp_path / "model.json"
    if there:
        model.write_text("another one")
    with pytest.raises(MissionFileError, match=r"put (it|the old one) back: its SHA-256 is 0000"):
        judge(model, recall=False)
    judge(model, recall=True)
    (line,) = said
    assert str(model) in line
    assert line.endswith("the aircraft are brought home without it")


def test_who_has_no_detector_says_nothing_of_a_picture() -> None:
    picture = np.zeros((4, 4, 3), np.uint8)
    for judge in (Blind().mask, Blind().probability):
        with pytest.raises(ImageError, match="only brought home"):
            judge(picture)
