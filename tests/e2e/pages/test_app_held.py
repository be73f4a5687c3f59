"""Rules of `uavmap app`, in one browser: offline, refusals, one holder, accessibility.

With UAVMAP_PICTURES=FOLDER in the environment it leaves pictures of the page there.
"""

from __future__ import annotations

import base64
import contextlib
import http.client
import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

import pytest

from sitl.sockets.server import free_ports
from tests.e2e import rig
from tests.support.page import accessibility
from tests.support.page.app_page import KML, Page, app
from tests.support.page.browser import browser, keep_picture, need_browser
from tests.support.page.proxy import RecordingProxy, recording_proxy
from tests.unit.uavmap.ui.ground.test_layers import mosaic
from uavmap.ui.app.jobs import LOGS
from uavmap.ui.app.server import TABS

SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
CLICKS = '([kind, what]) => kind === "event" && /^"?[0-9a-f]{16}/.test(what.args[0])'
"""Messages of buttons, in JavaScript."""
FIRST_VIEW_MS = 1000.0


class Day(NamedTuple):
    page: Page
    url: str
    proxy: RecordingProxy
    drawing: Path
    folder: Path

    @property
    def root(self) -> str:
        return self.url.partition("?")[0]

    def enter(self) -> None:
        self.page.driver.set_window_size(1280, 1000)
        self.page.driver.get(self.url)
        self.page.wait("you have the controls")

    def messages(self) -> None:
        """Record the messages that the page sends from now on, as `window.sent`."""
        self.page.driver.execute_script(
            "window.sent = []; const emit = window.socket.emit.bind(window.socket);"
            "window.socket.emit = (...what) => { window.sent.push(what); return emit(...what); }"
        )

    def commands(self) -> int:
        """Return the number of commands so far."""
        return len(list((self.folder / LOGS).glob("*.log")))


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Day]:
    need_browser()
    folder = tmp_path_factory.mktemp("fields")
    (folder / "note.html").write_text("<script>document.title = 'ran'</script>seen")
    flown = folder / "results" / "field-1"
    flown.mkdir(parents=True)
    (flown / "journal.jsonl").write_text("")
    mosaic(flown)
    (folder / "speck.toml").write_text((rig.MISSIONS / "speck.toml").read_text())
    drawing = tmp_path_factory.mktemp("sent") / "meadow.kml"
    drawing.write_text(KML)
    with (
        app(folder) as (_, url),
        recording_proxy() as proxy,
        browser(1280, 1000, proxy.port) as driver,
    ):
        yield Day(Page(driver), url, proxy, drawing, folder)
        assert not proxy.elsewhere


def _asked(day: Day, path: str, **headers: str) -> int:
    url = urlsplit(day.url)
    connection = http.client.HTTPConnection(url.hostname or "", url.port)
    with contextlib.closing(connection):
        connection.request("GET", path, headers=headers)
        return connection.getresponse().status


def _websocket(day: Day, **headers: str) -> int:
    upgrade = {
        "Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": base64.b64encode(b"0123456789abcdef").decode(),
    }  # fmt: skip
    return _asked(day, SOCKET, **upgrade, **headers)


def test_wrong_token_and_foreign_origin_are_refused(day: Day) -> None:
    url = urlsplit(day.url)
    token = url.query.removeprefix("token=")
    own = {"Cookie": f"uavmap-{url.port}={token}"}
    wrong = {"Cookie": f"uavmap-{url.port}=wrong"}
    foreign = {"Origin": "http://127.0.0.1:3000"}
    assert _asked(day, "/?token=wrong") == _asked(day, "/") == _asked(day, "/", **wrong) == 403
    assert _asked(day, "/", **own) == 200
    assert _websocket(day, **own) == 101
    for refused in (wrong, {**own, **foreign}, {**own, "Origin": "https://example.org"}):
        assert _asked(day, "/file/speck.toml", **refused) == 403
        assert _websocket(day, **refused) == 403


def test_files_of_the_folder_run_nothing_and_files_elsewhere_are_refused(day: Day) -> None:
    day.enter()
    driver = day.page.driver
    driver.get(f"{day.root}file/note.html")
    day.page.wait("seen")
    assert driver.title != "ran"
    driver.get_log("browser")  # it was refused, and the page shows that
    log = day.folder / LOGS / "1.log"
    log.parent.mkdir(exist_ok=True)
    log.write_text("live page: http://127.0.0.1:1/?token=secret")
    driver.get(f"{day.root}file/{LOGS}/{log.name}")
    assert not day.page.shows("secret")
    log.unlink()
    driver.get_log("browser")
    driver.get(f"{day.root}file/..%2f..%2fetc/passwd")
    assert not day.page.shows("root:")
    driver.get_log("browser")


def test_mosaic_of_the_newest_flight_is_beneath_where_there_is_no_map_file(day: Day) -> None:
    day.enter()
    day.page.wait("results/field-1/mosaic.webp")
    loaded = (
        "return [...document.querySelectorAll('.leaflet-tile-loaded')]"
        ".filter((tile) => tile.naturalWidth === 256).length"
    )
    rig.wait_until(lambda: day.page.driver.execute_script(loaded) > 0, "a tile", 60.0)
    assert not day.page.complaints()


def test_preflight_lists_the_doctors_findings_and_refuses_a_replayed_click(day: Day) -> None:
    day.enter()
    page, before = day.page, day.commands()
    page.open("Preflight")
    page.write_lines("URLs of the vehicles", f"udpin://127.0.0.1:{free_ports(1)[0]}")
    day.messages()
    page.press("Check the vehicles")
    page.see(".app-findings")
    page.wait("checking")
    columns = [cell.text for cell in page.driver.find_elements("css selector", ".app-findings th")]
    assert columns == ["", "vehicle", "subject", "found", "expected", "remedy"]
    rows = [row.text for row in page.driver.find_elements("css selector", ".app-findings tr")]
    assert any("Python" in row for row in rows)
    keep_picture(page.driver, "app-preflight.jpg")
    page.press("Ctrl-C")
    page.press("Yes", "[data-confirm=yes]")
    again = (
        f"const clicks = window.sent.filter({CLICKS});"
        "clicks.forEach((click) => window.socket.emit(...click)); return clicks.length"
    )
    assert page.driver.execute_script(again) >= 2
    page.wait("interrupted")
    page.wait("the check is not complete")
    assert day.commands() == before + 1


def test_second_browser_watches_until_the_controls_are_handed_over(day: Day) -> None:
    day.enter()
    page, driver = day.page, day.page.driver
    day.messages()
    page.send(day.drawing)
    page.wait("imported: meadow.kml")
    page.press("Make the mission")
    page.ended("uavmap new meadow.kml --out field.toml")
    before = day.commands()
    page.open("Areas")
    page.write("name of the mission", "another")
    first = driver.current_window_handle
    driver.switch_to.new_window("tab")
    second = driver.current_window_handle
    driver.get(day.root)
    page.wait("another browser has the controls")
    rig.wait_until(lambda: not page.see("button", "Make the mission").is_enabled(), "it may not")
    page.press("Request the controls")
    driver.switch_to.window(first)
    page.press("Hand over")
    page.wait("another browser has the controls")
    # the message of the button, with its current number
    driver.execute_script(
        f"const [kind, click] = window.sent.find({CLICKS});"
        "const button = [...document.querySelectorAll('button')].find("
        "(e) => e.textContent === 'Make the mission');"
        "window.socket.emit(kind, {...click, args: [JSON.stringify(button.dataset.click)]})"
    )
    driver.switch_to.window(second)
    page.wait("you have the controls")
    page.open("Results")
    page.open("Areas")
    assert day.commands() == before
    driver.close()
    driver.switch_to.window(first)


def test_every_tab_fits_a_phone_and_has_names_contrast_and_keys(day: Day) -> None:
    day.enter()
    driver, wrong = day.page.driver, {}
    for tab in TABS:
        day.page.open(tab)
        wrong |= {tab: found} if (found := accessibility.faults(driver)) else {}
    driver.set_window_size(390, 844)
    for tab in TABS:
        day.page.open(tab)
        keep_picture(driver, f"app-phone-{tab.lower()}.jpg")
        wrong |= {f"{tab}, phone": found} if (found := accessibility.faults(driver)) else {}
    assert not wrong, json.dumps(wrong, indent=1)
    assert not day.page.complaints()


def test_first_view_comes_within_a_second(day: Day) -> None:
    first_ms = (
        "return performance.getEntriesByName('first-contentful-paint').map((e) => e.startTime)"
    )
    took_ms = []
    for _ in range(3):  # the best: another program of this computer may be busy
        day.enter()
        rig.wait_until(lambda: bool(day.page.driver.execute_script(first_ms)), "the first view")
        took_ms += day.page.driver.execute_script(first_ms)
    assert min(took_ms) < FIRST_VIEW_MS, took_ms
