"""Alarms, figures and buttons of the live page in a real browser, by events of a recorded flight.

With UAVMAP_PICTURES=FOLDER in the environment it leaves pictures of the page there.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from missions.events import Connected, LinkLost, Tracked, TrafficSeen, from_json
from missions.flight.step import step
from missions.traffic import Track
from missions.units import GridPoint
from tests.e2e import rig
from tests.e2e.pages.test_page import Page
from tests.golden.recording import STOPS
from tests.support.page import accessibility
from tests.support.page.browser import browser, keep_picture, need_browser
from tests.support.shown_lines import ShownLines
from uavmap.base.messages import shown_on
from uavmap.ui.page.feed import Feed, serve_page
from uavmap.ui.page.page_scene import scene_of
from uavmap.ui.page.watching import Watcher

ALARMS = ".flight-alarms li:not(.known)"
SEEN = f"[...document.querySelectorAll('{ALARMS}')].map((e) => e.textContent).join('; ')"


class FlightOnPage:
    """The recorded flight on a page, up to the time that a test sets."""

    def __init__(self, feed: Feed) -> None:
        self.setting = STOPS.setting()
        self.state = self.setting.initial_state()
        self.watcher = Watcher(self.state, now_s=lambda: 0.0)
        self.events = iter([from_json(line) for line in STOPS.lines()])
        self._feed = feed
        self._version = 0
        feed.put({"kind": "scene", "scene": scene_of(self.setting)}, wait_s=5.0)
        self.watcher.board.set_field("hands_off", "")

    def happen(self, event: Any) -> None:
        self.state, _ = step(self.state, event)
        self.watcher.apply(event, self.state)

    def go_on_to(self, t_s: float) -> Tracked:
        """Fly on to the first place that a vehicle reports after a time."""
        for event in self.events:
            self.happen(event)
            if isinstance(event, Tracked) and event.t_s > t_s:
                return event
        raise AssertionError

    def send(self) -> None:
        self.watcher.refresh()
        delta = self.watcher.board.since(self._version)
        assert self._feed.put({"kind": "delta", "delta": delta}, wait_s=5.0)
        self._version = delta["v"]


@contextlib.contextmanager
def opened_page(width_px: int, height_px: int) -> Iterator[tuple[Page, FlightOnPage]]:
    need_browser()
    lines = ShownLines()
    config = {"title": "speck", "steers": True}
    with (
        shown_on(lines),
        serve_page(config, 0, "--page") as feed,
        browser(width_px, height_px) as driver,
    ):
        flown = FlightOnPage(feed)
        flown.go_on_to(40.0)
        flown.send()
        driver.get(lines.page)
        page = Page(driver)
        page.wait("flightMap.frames && flightMap.board.vehicles[1]")
        yield page, flown
        wrong = [entry for entry in driver.get_log("browser") if entry["level"] == "SEVERE"]
        assert not wrong


def test_alarm_that_is_acknowledged_shows_and_sounds_again_only_when_it_comes_anew():
    with opened_page(1280, 800) as (page, flown):
        assert page.shows(SEEN) == ""
        last = flown.go_on_to(45.0)
        flown.happen(LinkLost(1, last.t_s))
        flown.send()
        page.wait(f"{SEEN} === 'vehicle 1: link lost'")
        assert page.shows("flightSound.times") >= 1
        assert not accessibility.faults(page.driver)
        keep_picture(page.driver, "page-alarm.jpg")
        page.press(".flight-alarms button")
        page.wait(f"document.querySelector('.flight-alarms.known') && {SEEN} === ''")
        assert not accessibility.faults(page.driver)

        home = flown.state.vehicles[1].home
        back = Connected(1, last.t_s, home, last.position, last.height_m, True, True, 40.0)
        flown.happen(back)
        flown.send()
        page.wait("!document.querySelector('.flight-alarms')")
        flown.happen(LinkLost(1, last.t_s + 1.0))
        flown.send()
        page.wait(f"{SEEN} === 'vehicle 1: link lost'")
        flown.happen(replace(back, t_s=last.t_s + 2.0))
        away = GridPoint(last.position.east_m + 5000.0, last.position.north_m)
        flown.happen(Tracked(1, last.t_s + 3.0, away, last.height_m, 40.0))
        flown.send()
        page.wait(f"{SEEN}.includes('vehicle 1: outside of the fence')")
        assert "battery below the need of the return path" in page.shows(SEEN)

        t_s, still = flown.state.t_s, GridPoint(0.0, 0.0)
        passes = Track("3C6444", "DLH1", t_s, GridPoint(4990.0, 600.0), 90.0, 0.0, still)
        flown.happen(TrafficSeen(t_s, (passes,)))
        flown.send()
        page.wait(f"{SEEN}.includes('traffic is near')")
        figures = page.shows("document.querySelector('.flight-figures').textContent")
        assert "held for traffic" in figures
        assert "DLH1, 5026 m E of the start, 90 m up" in figures
        assert page.shows("flightMap.board.fields.traffic[0].name") == "DLH1"
        page.wait("document.querySelector('[data-order=continue]').offsetParent")
        keep_picture(page.driver, "page-traffic.jpg")


def test_phone_shows_figures_legend_and_a_large_return_at_the_bottom():
    with opened_page(390, 844) as (page, flown):
        page.wait("document.querySelector('[data-order=return]')")
        rig.wait_until(
            lambda: page.driver.find_element("css selector", "[data-order=return]").is_displayed(),
            "the buttons",
        )
        width, height = page.shows("window.innerWidth"), page.shows("window.innerHeight")
        assert width == 390
        sizes = {
            order: page.shows(
                f"(({{x, y, width, height, bottom}}) => [width, height, bottom])"
                f"(document.querySelector('[data-order={order}]').getBoundingClientRect())"
            )
            for order in ("pause", "return")
        }
        (pause_w, pause_h, _), (return_w, return_h, bottom) = sizes["pause"], sizes["return"]
        assert return_w > 1.5 * pause_w
        assert return_h > pause_h
        assert return_h >= 48
        assert height - 24 <= bottom <= height
        legend = page.shows("document.querySelector('.flight-legend').textContent")
        for name in ("search box", "geofence", "home", "track", "path ahead", "on the ground"):
            assert name in legend
        assert page.driver.find_element("css selector", ".flight-north").is_displayed()
        figures = page.shows("document.querySelector('.flight-vehicles li').textContent")
        for name in ("control", "uavmap", "speed", "m/s", "home", "camera", "left"):
            assert name in figures
        keep_picture(page.driver, "page-phone-orders.jpg")
        page.driver.execute_script("window.scrollTo(0, 700)")
        keep_picture(page.driver, "page-phone-figures.jpg")
        flown.happen(LinkLost(1, flown.go_on_to(45.0).t_s))
        flown.send()
        page.wait("document.querySelector('.flight-alarms')")
        assert not accessibility.faults(page.driver)
        page.press("[data-order=return]")
        page.wait("document.querySelector('[data-confirm=yes]')?.offsetParent")
        assert not accessibility.faults(page.driver)
        page.driver.switch_to.active_element.send_keys("\ue00c")  # Escape
        page.wait("!document.querySelector('[data-confirm=yes]')")
