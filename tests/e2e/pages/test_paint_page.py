"""The page to paint examples on, in a real browser: accessible, and usable with keys alone."""

from __future__ import annotations

import cv2
import numpy as np

from tests.e2e import rig
from tests.support.page import accessibility
from tests.support.page.browser import browser, need_browser
from tests.unit.uavmap.photos.test_replay import painted
from uavmap.photos.tune.paint_page import Easel, served

STEPS = 10
STEP_PX = 10


def test_paint_page_keys_alone_paint_a_polygon_without_accessibility_faults(tmp_path):
    need_browser()
    from selenium.webdriver import Keys  # noqa: PLC0415 - it may be missing

    masks = tmp_path / "masks"
    masks.mkdir()
    easel = Easel(painted(tmp_path / "pictures"), masks, 640)
    with served(easel) as url, browser(1280, 900) as driver:
        driver.get(url)
        ready = "return levels.length > 0 && document.querySelectorAll('#kinds button').length > 2"
        rig.wait_until(lambda: bool(driver.execute_script(ready)), "the first picture")
        assert not accessibility.faults(driver)
        driver.find_element("css selector", "[data-tool=polygon]").send_keys(Keys.SPACE)
        canvas = driver.find_element("id", "shown")
        canvas.send_keys(" ", Keys.ARROW_RIGHT * STEPS, " ", Keys.ARROW_DOWN * STEPS, " ")
        canvas.send_keys(Keys.ENTER)
        driver.find_element("id", "save").send_keys(Keys.SPACE)
        rig.wait_until(lambda: driver.find_element("id", "said").text == "saved 0.png", "the mask")
        driver.set_window_size(390, 844)
        assert not accessibility.faults(driver)
        assert not [each for each in driver.get_log("browser") if each["level"] == "SEVERE"]
    mask = cv2.imread(str(masks / "0.png"), cv2.IMREAD_GRAYSCALE)
    side_px = STEPS * STEP_PX
    assert abs(np.count_nonzero(mask == 255) - side_px**2 / 2) <= side_px
