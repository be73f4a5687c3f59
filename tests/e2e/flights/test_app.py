"""`uavmap app` in a real browser: from an empty folder to a flown map, without a terminal.

With UAVMAP_PICTURES=FOLDER in the environment it leaves pictures of the page there.
"""

from __future__ import annotations

import contextlib
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.e2e import rig
from tests.support.page.browser import browser, keep_picture, need_browser

CORNERS = "8.6,47.4 8.601,47.4 8.601,47.401 8.6,47.401 8.6,47.4"
KML = f"""<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>meadow</name><Polygon>
<outerBoundaryIs><LinearRing><coordinates>{CORNERS}</coordinates></LinearRing></outerBoundaryIs>
</Polygon></Placemark></kml>"""


@contextlib.contextmanager
def app(folder: Path) -> Iterator[tuple[Any, str]]:
    with rig.started("app", folder, "--port", 0) as process:
        line = process.stderr.readline()
        found = re.search(r"uavmap app: (http\S+)", line)
        assert found, line
        yield process, found[1]


class Page:
    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def found(self, selector: str, text: str | None = None) -> Any:
        """The first element that is shown; of those with a text the one that has it."""
        for each in self.driver.find_elements("css selector", selector):
            with contextlib.suppress(Exception):  # it moves, or is gone again
                if each.is_displayed() and (text is None or each.text == text):
                    return each
        return None

    def press(self, text: str | None, selector: str = "button") -> None:
        rig.wait_until(lambda: self._pressed(selector, text), f"{text or selector} to press", 60.0)

    def _pressed(self, selector: str, text: str | None) -> bool:
        button = self.found(selector, text)
        with contextlib.suppress(Exception):
            if button is not None and button.is_enabled():
                button.click()
                return True
        return False

    def open(self, tab: str) -> None:
        self.press(tab, ".q-tab")

    def write(self, label: str, text: str) -> None:
        from selenium.webdriver import Keys  # noqa: PLC0415 - it may be missing

        box = self.found(f'input[aria-label^="{label}"]')
        box.send_keys(Keys.CONTROL, "a")
        box.send_keys(text)

    def send(self, name: str, folder: Path, text: str) -> None:
        """Choose a file to import."""
        folder.mkdir()
        (folder / name).write_text(text)
        self.driver.find_element("css selector", "input[type=file]").send_keys(str(folder / name))

    def says(self, text: str) -> bool:
        return text in self.driver.find_element("tag name", "body").text

    def wait(self, text: str) -> None:
        rig.wait_until(lambda: self.says(text), text, 90.0)

    def drag(self, tool: str) -> None:
        """Draw a rectangle over the middle of the map."""
        from selenium.webdriver import ActionChains  # noqa: PLC0415 - it may be missing

        self.press(None, f".leaflet-draw-draw-{tool}")
        middle = ActionChains(self.driver).move_to_element_with_offset
        drawn = middle(self.found(".app-leaflet"), -50, -40).click_and_hold()
        drawn.move_by_offset(100, 80).release().perform()


def test_from_an_empty_folder_to_a_map_with_clicks_alone(tmp_path):
    need_browser()
    with app(tmp_path) as (process, url), browser(1280, 1000) as driver:
        page = Page(driver)
        driver.get(url)
        page.wait("you hold the controls")
        page.press("Make the mission")
        page.wait("no area: draw one on the map, or import a file")
        page.write("go to", "47.3, 8.5")
        page.press("Go")
        rig.wait_until(lambda: page.found(".leaflet-draw-draw-rectangle") is not None, "the map")
        page.drag("rectangle")
        page.wait("drawn: 1")
        page.press("Undo")
        page.wait("drawn: 0")
        page.drag("rectangle")
        page.wait("drawn: 1")
        page.press("Make the mission")
        page.wait("uavmap new field.geojson --out field.toml --drone sim")
        page.wait("done (exit code 0)")
        rig.wait_until(lambda: page.found(".app-plan img") is not None, "the plan")
        keep_picture(driver, "app-areas.jpg")
        page.send("drawn by a friend.kml", tmp_path / "sent", KML)
        page.wait("imported: drawn by a friend.kml")
        page.write("name of the mission", "meadow")
        page.press("Make the mission")
        page.wait("uavmap new 'drawn by a friend.kml' --out meadow.toml")
        page.wait("done (exit code 0)")
        # a mission whose ground has a region, as a file that came by mail
        shutil.copy(rig.mission("speck"), tmp_path / "a speck.toml")
        page.open("Practise")
        page.press("field.toml", ".q-field__native span")
        page.press("a speck.toml", ".q-item")
        page.press("5 times", ".q-field__native span")
        page.press("20 times", ".q-item")
        page.press("Practise")
        page.wait("uavmap fly 'a speck.toml' --speedup 20 --page 0 --yes --auto-swap --connect")
        rig.wait_until(lambda: page.found("a", "live page") is not None, "the live page")
        assert "/?token=" in page.found("a", "live page").get_attribute("href")
        keep_picture(driver, "app-practise.jpg")
        page.open("Results")
        page.wait("complete, ")
        page.wait("done (exit code 0)")
        keep_picture(driver, "app-results.jpg")
        page.press("Report")
        page.wait("report.html")
        page.open("Commands")
        page.wait("uavmap sitl --mission 'a speck.toml'")
        rig.wait_until(lambda: process.poll() is None and not _running(tmp_path), "all to end")
        complaints = [e for e in driver.get_log("browser") if e["level"] == "SEVERE"]
        assert not complaints
        assert (tmp_path / "field.toml").is_file()
        assert (tmp_path / "results" / "speck-1" / "report.html").is_file()


def _running(folder: Path) -> list[int]:
    """The processes of commands of a folder."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            words = (entry / "cmdline").read_bytes().split(b"\0")
            if b"uavmap" in words and (entry / "cwd").resolve() == folder.resolve():
                found.append(int(entry.name))
    return found


def test_one_browser_holds_the_controls_and_files_elsewhere_are_refused(tmp_path):
    need_browser()
    (tmp_path / "note.html").write_text("<script>document.title = 'ran'</script>seen")
    with app(tmp_path) as (_, url), browser(1280, 1000) as driver:
        page = Page(driver)
        driver.get(url)
        page.wait("you hold the controls")
        root = url.partition("?")[0]
        driver.get(f"{root}file/note.html")
        page.wait("seen")
        assert driver.title != "ran"
        driver.get(f"{root}file/..%2f..%2fetc/passwd")
        assert not page.says("root:")
        driver.get(url)
        page.wait("you hold the controls")
        first = driver.current_window_handle
        driver.switch_to.new_window("tab")
        driver.get(url)
        page.wait("another browser holds the controls")
        assert not page.found("button", "Make the mission").is_enabled()
        page.press("Ask for the controls")
        second = driver.current_window_handle
        driver.switch_to.window(first)
        page.press("Hand over")
        page.wait("another browser holds the controls")
        driver.switch_to.window(second)
        page.wait("you hold the controls")
        driver.set_window_size(390, 844)
        rig.wait_until(lambda: _fits(driver), "a page as wide as a phone")


def _fits(driver: Any) -> bool:
    script = "return document.documentElement.scrollWidth <= window.innerWidth"
    return bool(driver.execute_script(script))
