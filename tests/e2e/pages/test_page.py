"""The live page in a real browser: its buttons steer a flight over sockets.

With UAVMAP_PICTURES=FOLDER in the environment it leaves pictures of the page there.
"""

from __future__ import annotations

import contextlib
import queue
import re
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from tests.e2e import rig
from tests.support.page.browser import FOLDER, browser, keep_picture, need_browser

SPEEDUP = 3.0
"""Slow enough that a battery outlasts a pause in which a busy machine starts tabs."""


@contextlib.contextmanager
def with_page(*arguments: object) -> Iterator[tuple[Any, str]]:
    lines: queue.Queue[str] = queue.Queue()
    with rig.started(*arguments) as process:
        heard = process.stderr

        def read() -> None:
            for line in heard:
                lines.put(line)
                print(line, end="")  # shown where the test fails

        reader = threading.Thread(target=read)
        reader.start()
        try:
            while not (
                found := re.search(r"live page: (http\S+)", lines.get(timeout=rig.PATIENCE_S))
            ):
                pass
            yield process, found[1]
        finally:
            process.kill()
            reader.join()


class Page:
    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def press(self, selector: str) -> None:
        def pressed() -> bool:
            for button in self.driver.find_elements("css selector", selector):
                with contextlib.suppress(Exception):  # it moves, or is gone again
                    if button.is_displayed():
                        button.click()
                        return True
            return False

        rig.wait_until(pressed, selector)

    def confirmed(self, order: str) -> None:
        self.press(f"[data-order={order}]")
        self.press("[data-confirm=yes]")

    def shows(self, script: str) -> Any:
        return self.driver.execute_script(f"return window.flightMap ? {script} : null")

    def wait(self, script: str) -> None:
        rig.wait_until(lambda: bool(self.shows(script)), script)


def test_buttons_steer_a_flight_and_the_page_survives_its_reader(folder):
    need_browser()
    with rig.simulator("speck", speedup=SPEEDUP) as urls:
        lines = [
            "fly",
            rig.mission("speck"),
            *rig.arguments_of(urls),
            "--speedup",
            SPEEDUP,
            "--page",
            "0",
        ]
        flight = with_page(*lines, "--auto-swap", "--out", folder)
        with browser() as driver, flight as (process, url):
            page = Page(driver)
            driver.get(url)
            rig.wait_until(
                lambda: bool(rig.events(folder, "airborne")) or process.poll() is not None,
                "the take-off",
            )
            assert process.poll() is None, "it was not flown"
            page.confirmed("pause")
            rig.wait_for(folder, "paused")
            page.wait("flightMap.board.fields.paused && flightMap.board.vehicles[1]")

            driver.delete_all_cookies()
            driver.get(url.partition("token=")[0] + "token=wrong")
            assert "Not allowed" in driver.find_element("tag name", "body").text
            driver.get(url)
            assert "token" not in driver.current_url
            driver.refresh()
            page.wait("flightMap.board.fields.paused && flightMap.frames")
            first = driver.current_window_handle
            driver.switch_to.new_window("tab")
            driver.get(url)
            driver.set_window_size(390, 844)
            page.wait("flightMap.board.version && flightMap.frames")
            width = driver.execute_script("return document.documentElement.scrollWidth")
            assert width <= driver.execute_script("return window.innerWidth") <= 400
            keep_picture(driver, "page-phone.jpg")
            driver.close()
            driver.switch_to.window(first)
            driver.set_window_size(1280, 800)

            page.confirmed("continue")
            rig.wait_for(folder, "continued")
            page.confirmed("return")
            rig.wait_for(folder, "recalled")
            page.wait("document.querySelector('.flight-banner')?.textContent.includes('is over')")
            complaints = [
                e for e in driver.get_log("browser") if "Content Security" in e["message"]
            ]
            assert not complaints
            code = process.wait()
    assert code == 3
    kinds = [event["kind"] for event in rig.events(folder, "paused", "continued", "recalled")]
    assert kinds == ["paused", "continued", "recalled"]


def test_page_gives_the_pictures_of_the_documentation(tmp_path):
    if not FOLDER:
        pytest.skip("UAVMAP_PICTURES=FOLDER asks for the pictures of docs/how-to/page.md")
    need_browser()
    flight = ["fly", "runway", "--sim", "--vehicles", 2, "--speedup", 10, "--page", 0]
    with (
        with_page(*flight, "--out", tmp_path / "out") as (process, url),
        browser(1180, 880) as driver,
    ):
        page = Page(driver)
        driver.get(url)
        page.wait("flightMap.board.fields.roi > 90 && flightMap.board.fields.picture")
        page.wait("document.querySelector('.flight-picture figcaption').textContent")
        keep_picture(driver, "page.jpg")
        assert process.wait() == 0


def test_folder_that_cannot_be_watched_is_refused_in_a_line(tmp_path):
    for folder, expected in ((tmp_path / "none", "no such folder"), (tmp_path, "no journal")):
        done = rig.uavmap("watch", folder, "--port", "0")
        assert (done.code, done.out) == (2, "")
        assert expected in done.err
        assert len(done.err.splitlines()) == 1
    done = rig.uavmap(
        "fly", rig.mission("speck"), "--sim", "--tiles", "x.mbtiles", "--out", tmp_path / "a"
    )
    assert (done.code, "--page" in done.err) == (2, True)
    done = rig.uavmap("fly", rig.mission("speck"), "--sim", "--page", "70000")
    assert done.code == 2
