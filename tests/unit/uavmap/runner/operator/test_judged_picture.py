"""One picture of a flight is kept, with the outline of the region that the detector found."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from missions.events import FrameSeen, Vote
from missions.flight.setting_of import setting_of
from missions.units import Cell, LatLon, Pose, Quaternion
from tests.support.small_missions import mission, square
from uavmap.journal.kept_frames import KeptFrame
from uavmap.output.drawing.judged import FILE, MAX_WIDE_PX, outlined
from uavmap.runner.operator.judged_picture import JudgedPicture

SETTING = setting_of(mission(square(-10, 16, 40, 30), square(-60, -60, 160, 160)))
STATE = SETTING.initial_state()
POSE = Pose(LatLon(52.0, 13.0), 12.0, Quaternion(1.0, 0.0, 0.0, 0.0))


def picture(dark_columns: int, bright: int = 200) -> np.ndarray:
    made = np.full((240, 320, 3), bright, np.uint8)
    made[60:180, 100 : 100 + dark_columns] = 60
    return made


def seen(t_s: float, *, region: bool) -> FrameSeen:
    return FrameSeen(1, t_s, None, (Vote(Cell(0, 0), region, float(region)),))


def show_picture(
    keeper: JudgedPicture, t_s: float, image: np.ndarray | bytes, *, region: bool
) -> None:
    keeper.keep(KeptFrame(f"{t_s}.png", 1, t_s, POSE, 80.0), image)
    keeper.update(seen(t_s, region=region), STATE, 0)


def red(path: Path) -> np.ndarray:
    with Image.open(path) as found:
        pixels = np.asarray(found.convert("RGB")).astype(int)
    return (pixels[..., 0] > 150) & (pixels[..., 1] < 90) & (pixels[..., 2] < 90)


def test_judged_picture_is_the_first_with_region_and_has_its_outline(tmp_path):
    keeper = JudgedPicture(tmp_path, SETTING)
    show_picture(keeper, 1.0, picture(0, 180), region=False)
    good, data = cv2.imencode(".png", picture(100))
    assert good
    show_picture(keeper, 2.0, data.tobytes(), region=True)
    show_picture(keeper, 3.0, picture(200), region=True)
    keeper.end()
    rows, columns = np.nonzero(red(tmp_path / FILE))
    # the region less the dilations of the surround
    assert (columns.min(), columns.max()) == pytest.approx((107, 192), abs=3)
    assert (rows.min(), rows.max()) == pytest.approx((67, 172), abs=3)


def test_judged_picture_without_region_is_the_first_one(tmp_path):
    keeper = JudgedPicture(tmp_path, SETTING)
    show_picture(keeper, 1.0, picture(0, 180), region=False)
    show_picture(keeper, 2.0, picture(0, 240), region=False)
    keeper.end()
    assert not red(tmp_path / FILE).any()
    with Image.open(tmp_path / FILE) as found:
        assert np.asarray(found).mean() == pytest.approx(180, abs=2)


def test_judged_picture_stays_after_a_resume(tmp_path):
    for found in (True, False):  # a picture without region makes room for one with it
        (tmp_path / FILE).write_bytes(b"of before")
        keeper = JudgedPicture(tmp_path, SETTING, found=found)
        show_picture(keeper, 1.0, picture(100), region=True)
        keeper.end()
        assert ((tmp_path / FILE).read_bytes() == b"of before") is found


def test_judged_picture_that_cannot_be_read_is_left_out_with_a_line(tmp_path, caplog):
    keeper = JudgedPicture(tmp_path, SETTING)
    with caplog.at_level("INFO", "uavmap.flight"):
        show_picture(keeper, 1.0, b"no picture", region=True)
        keeper.end()
    assert "judged.jpg: the judged picture is left out (1.0.png: not a readable" in caplog.text
    assert not (tmp_path / FILE).exists()


def test_outlined_picture_is_small():
    image = np.full((3000, 4000, 3), 128, np.uint8)
    with Image.open(io.BytesIO(outlined(image, np.zeros((30, 40))))) as found:
        assert found.size == (MAX_WIDE_PX, 750)
