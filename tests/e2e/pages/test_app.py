"""`uavmap app` in a real browser: a stranger's day from an empty folder, without a terminal.

With UAVMAP_PICTURES=FOLDER in the environment it leaves pictures of the page there.
"""

from __future__ import annotations

import contextlib
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pypdfium2

from tests.e2e import rig
from tests.support.page.app_page import KML, Page, app
from tests.support.page.browser import browser, keep_picture, need_browser
from tests.support.page.proxy import recording_proxy

DARK = 140
"""Gray level between the region and the ground of the simulator."""
RIM_PX = 16
"""Distance from the rim of a frame below which a region may be cut, px."""


def test_stranger_goes_from_an_empty_folder_to_pdf_and_kmz_with_clicks_alone(tmp_path):
    need_browser()
    folder = tmp_path / "fields"
    folder.mkdir()
    (tmp_path / "drawn by a friend.kml").write_text(KML)
    with (
        app(folder) as (process, url),
        recording_proxy() as proxy,
        browser(1280, 1000, proxy.port) as driver,
    ):
        page = Page(driver)
        driver.get(url)
        page.wait("you have the controls")
        _make_missions(page, tmp_path / "drawn by a friend.kml")
        _take_fewer_pictures(folder / "meadow.toml")
        _practise(page, folder)
        _paint_two(page, folder / "results" / "meadow-1" / "frames")
        page.choose("detector", "meadow-1-detector")
        page.press("Map")
        page.ended("uavmap replay results/meadow-1 --detector meadow-1-detector")
        _hand_on(page, folder / "results" / "meadow-1-1")
        page.open("Commands")
        page.wait("uavmap sitl --mission meadow.toml")
        rig.wait_until(lambda: process.poll() is None and not _running(folder), "all to end")
        assert not page.complaints()
        assert not proxy.elsewhere
        assert "127.0.0.1" in proxy.hosts


def _make_missions(page: Page, drawing: Path) -> None:
    page.press("Make the mission")
    page.wait("no area: draw one on the map, or import a file")
    page.write("go to", "47.3, 8.5")
    page.press("Go")
    page.see(".leaflet-draw-draw-rectangle")
    _drag(page)
    page.wait("drawn: 1")
    page.press("Undo")
    page.wait("drawn: 0")
    _drag(page)
    page.wait("drawn: 1")
    page.press("Make the mission")
    page.ended("uavmap new field.geojson --out field.toml --drone sim")
    page.see(".app-plan img")
    keep_picture(page.driver, "app-areas.jpg")
    page.send(drawing)
    page.wait("imported: drawn by a friend.kml")
    page.write("name of the mission", "meadow")
    page.press("Make the mission")
    page.ended("uavmap new 'drawn by a friend.kml' --out meadow.toml")


def _take_fewer_pictures(mission: Path) -> None:
    """Take a fifth of the pictures: their map is ready sooner, which is all that changes."""
    text = mission.read_text("utf-8")
    assert "interval_s = 0.2 " in text
    mission.write_text(text.replace("interval_s = 0.2 ", "interval_s = 1.0 "), "utf-8")


def _drag(page: Page) -> None:
    """Draw a rectangle over the middle of the map."""
    from selenium.webdriver import ActionChains  # noqa: PLC0415 - it may be missing

    page.press(None, ".leaflet-draw-draw-rectangle")
    middle = ActionChains(page.driver).move_to_element_with_offset
    drawn = middle(page.element(".app-leaflet"), -50, -40).click_and_hold()
    drawn.move_by_offset(100, 80).release().perform()


def _practise(page: Page, folder: Path) -> None:
    """Fly in the simulator with the live page's buttons, then land."""
    page.open("Practise")
    page.choose("mission", "meadow.toml")
    page.press("Practise")
    flown = folder / "results" / "meadow-1"
    with page.within():
        page.see("[data-order=pause]")
        rig.wait_until(lambda: bool(rig.events(flown, "airborne")), "the take-off")
        page.press(None, "[data-order=pause]")
        page.press(None, "[data-confirm=yes]")
        rig.wait_for(flown, "paused")
        keep_picture(page.driver, "app-practise.jpg")
        page.press(None, "[data-order=continue]")
        page.press(None, "[data-confirm=yes]")
        rig.wait_for(flown, "continued")
        page.wait("is over")
    page.press("Back")
    page.ended("uavmap fly meadow.toml --speedup 5 --page 0 --yes --auto-swap --keep-frames")


def _paint_two(page: Page, frames: Path) -> None:
    """Paint the region in two frames that show all of it, one from near, one from farther."""
    page.open("Pictures")
    page.press("Paint and learn")
    seen = sorted(filter(_area, frames.glob("*.jpg")), key=_area, reverse=True)
    with page.within():
        page.see("#kinds button")
        for frame in (seen[0], seen[len(seen) // 2]):
            _paint(page, frame)
        keep_picture(page.driver, "app-paint.jpg")
        page.press("save and end")
        page.wait("Saved.")
    page.press("Back")
    page.ended("uavmap tune results/meadow-1/frames --paint --examples meadow-1-painted")


def _ring(frame: Path) -> Any:
    """Return the outline of the region in a frame, px, shape (n, 2); empty if the rim cuts it."""
    image = cv2.GaussianBlur(cv2.imread(str(frame), cv2.IMREAD_GRAYSCALE), (15, 15), 0)
    rings, _ = cv2.findContours(
        (image < DARK).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE
    )
    ring = max(rings, key=cv2.contourArea, default=np.zeros((0, 1, 2), np.int32))
    x, y, width, height = cv2.boundingRect(ring)
    inside = min(x, y, image.shape[1] - x - width, image.shape[0] - y - height) > RIM_PX
    return cv2.approxPolyDP(ring, 3.0, True)[:, 0, :] if inside else ring[:0, 0, :]


def _area(frame: Path) -> float:
    ring = _ring(frame)
    return float(cv2.contourArea(ring)) if len(ring) else 0.0


def _paint(page: Page, frame: Path) -> None:
    from selenium.webdriver import ActionChains  # noqa: PLC0415 - it may be missing
    from selenium.webdriver.support.ui import Select  # noqa: PLC0415

    names = Select(page.driver.find_element("id", "which"))
    names.select_by_visible_text(frame.stem)
    name = f"picture/{names.options.index(names.first_selected_option)}"
    ready = f"return document.getElementById('picture').src.endsWith('{name}') && levels.length > 0"
    rig.wait_until(lambda: bool(page.driver.execute_script(ready)), frame.stem)
    page.press("polygon")
    page.driver.execute_script("window.scrollTo(0, 0)")
    canvas = page.element("#shown")
    size = canvas.size
    scale = size["width"] / cv2.imread(str(frame)).shape[1]
    clicks = ActionChains(page.driver, duration=0)
    for x, y in _ring(frame).tolist():
        at = x * scale - size["width"] / 2, y * scale - size["height"] / 2
        clicks.move_to_element_with_offset(canvas, *map(round, at)).click()
    clicks.double_click().perform()
    painted = "return levels.filter((level) => level === 255).length > 1000"
    rig.wait_until(lambda: bool(page.driver.execute_script(painted)), "a painted region", 30.0)
    page.press("the rest is surround")
    page.press("save")
    page.wait(f"saved {frame.stem}.png")


def _hand_on(page: Page, flown: Path) -> None:
    """Make the report and the KMZ of the newest map, and check them."""
    page.open("Results")
    page.see(".app-result", None)
    page.wait("results/meadow-1-1")
    page.press("Report (PDF)")
    page.ended("uavmap report results/meadow-1-1")
    page.press("Export")
    page.ended("uavmap export results/meadow-1-1 --to kmz")
    page.see("a", "flight.kmz")
    keep_picture(page.driver, "app-results.jpg")
    for name in ("report.pdf", "flight.kmz"):
        status = page.driver.execute_script(
            "const asked = new XMLHttpRequest(); asked.open('GET', arguments[0], false);"
            "asked.send(); return asked.status",
            page.element("a", name).get_attribute("href"),
        )
        assert status == 200
    assert len(pypdfium2.PdfDocument(flown / "report.pdf")) == 2
    with zipfile.ZipFile(flown / "flight.kmz") as file:
        assert "doc.kml" in file.namelist()


def _running(folder: Path) -> list[int]:
    """Return the processes of commands of a folder."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            words = (entry / "cmdline").read_bytes().split(b"\0")
            if b"uavmap" in words and (entry / "cwd").resolve() == folder.resolve():
                found.append(int(entry.name))
    return found
