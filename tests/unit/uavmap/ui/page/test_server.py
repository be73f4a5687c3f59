"""The page's process through HTTP and NiceGUI's socket, without a browser, beside a stub flight."""

import asyncio
import contextlib
import os
import re
import select
import signal
import socket
from pathlib import Path

import cv2
import httpx
import numpy as np
import pytest

from missions.errors import OutputError, UavmapError
from tests.support.page.page_tab import PATIENCE_S, Tab
from tests.support.running import by, in_real_time
from tests.support.shown_lines import ShownLines
from uavmap.base.messages import shown_on
from uavmap.ui.page import feed
from uavmap.ui.page.board import Board
from uavmap.ui.page.feed import serve_page
from uavmap.ui.page.hub import Hub

pytest.importorskip("nicegui", reason="the live page needs the extra page")
SCENE = {"mission": "a <field>", "states": [["explored", "#00ff00"]], "box": [], "vehicles": 2}


class Flight:
    def __init__(self, feed, said):
        self.feed, self.lines = feed, said
        self.url = said.page
        self.board = Board()
        self.version = 0
        feed.put({"kind": "scene", "scene": SCENE}, wait_s=PATIENCE_S)
        self.set(hands_off="", paused=False, t_s=0.0)

    def set(self, **fields):
        for name, value in fields.items():
            self.board.set_field(name, value)
        self.send_delta()

    def send_delta(self):
        delta = self.board.since(self.version)
        assert self.feed.put({"kind": "delta", "delta": delta}, wait_s=PATIENCE_S)
        self.version = delta["v"]

    def ordered(self):
        while not (orders := self.feed.orders()):
            assert select.select([self.feed.orders_file], [], [], PATIENCE_S)[0]
        (order,) = orders
        return order


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    lines = ShownLines()
    folder = tmp_path_factory.mktemp("results")
    frames = folder / "frames"
    frames.mkdir()
    (folder / "mosaic.webp").write_bytes(b"the ground")
    cv2.imwrite(str(frames / "1-000001.000.jpg"), np.full((90, 1280, 3), 80, np.uint8))
    (frames.parent / "secret.jpg").write_bytes((frames / "1-000001.000.jpg").read_bytes())
    config = {"title": "a <field>", "steers": True, "timeline": True, "folder": str(folder)}
    with shown_on(lines), serve_page(config, 0, "--page") as feed:
        yield Flight(feed, lines)


@contextlib.contextmanager
def tab(flight, **options):
    opened_tab = Tab(flight.url, **options)
    try:
        yield opened_tab
    finally:
        opened_tab.close()


def shows(page, flight):
    return page.board.version == flight.board.version


def test_tab_gets_a_snapshot_then_deltas_and_a_second_one_the_same(flight):
    for code in range(20):
        flight.board.set_cell((code, -code), code % 3)
    flight.send_delta()
    with tab(flight) as one, tab(flight) as two:
        one.wait(lambda: shows(one, flight))
        assert one.scene["mission"] == "a <field>"
        flight.board.set_cell((0, 0), 5)
        flight.board.set_vehicle(2, {"e": 1.0, "n": 2.0, "doing": "flying"})
        flight.board.set_vehicle(1, {"e": 0.0, "n": 2.0, "doing": "flying"})
        flight.send_delta()
        for page in (one, two):
            page.wait(lambda page=page: shows(page, flight))
            assert page.board.since(0) == flight.board.since(0)
        assert one.snapshots == 1


def test_tab_that_confirms_nothing_gets_no_more(flight):
    with tab(flight, confirms=False) as slow, tab(flight) as quick:
        slow.wait(lambda: slow.scene)
        for t_s in range(5):
            flight.set(t_s=float(t_s))
            quick.wait(lambda: shows(quick, flight))
        assert slow.takes == 0


def test_buttons_ask_first_and_the_flight_answers(flight):
    with tab(flight) as page:
        page.press("Pause")
        page.press("No")
        page.wait(lambda: "Yes" not in page.buttons().values())
        page.press("Pause")
        page.press("Yes")
        order = flight.ordered()
        assert order["do"] == "pause"
        flight.feed.put({"kind": "answer", "id": order["id"], "text": "all vehicles hold"})
        page.wait(lambda: "all vehicles hold" in page.notes)
        flight.set(paused=True)
        page.wait(lambda: {"Continue", "Return"} <= set(page.buttons().values()))
        assert "Pause" not in page.buttons().values()
        page.press("Continue")
        page.press("Yes")
        assert flight.ordered()["do"] == "continue"
        flight.set(paused=False)


def test_tab_after_the_flight_has_no_buttons(flight):
    with tab(flight) as page:
        page.wait(lambda: "Pause" in page.buttons().values())
        flight.set(hands_off="no vehicle flies")
        page.wait(lambda: "Pause" not in page.buttons().values())
        assert any(e.get("text") == "no vehicle flies" for e in page.elements.values())
    flight.set(hands_off="")


def test_slider_shows_an_earlier_board(flight):
    flight.set(t_s=100.0, roi=1)
    flight.set(t_s=200.0, roi=2)
    with tab(flight) as page:
        page.wait(lambda: page.board.field("roi") == 2)
        (number,) = [n for n, e in page.elements.items() if e["tag"] == "q-slider"]
        page.event(number, "update:modelvalue", 150.0)
        page.wait(lambda: page.board.field("roi") == 1)
        assert page.board.field("t_s") == 100.0
        assert not page.link["live"]
        page.press("Now")
        page.wait(lambda: page.board.field("roi") == 2)


def test_page_without_the_token_is_refused(flight):
    base, _, token = flight.url.partition("?token=")
    with httpx.Client() as client:
        queries = ("?token=", "?token=wrong", f"?token={token}&token=wrong")
        for path in ("", *queries, "picture/1", "_nicegui_ws/socket.io/?EIO=4"):
            answer = client.get(base + path)
            assert (answer.status_code, "token" in answer.text) == (403, True), path
        assert client.get(flight.url).status_code == 303
        assert client.get(base).status_code == 200
        other = {"origin": "http://127.0.0.1:1"}
        assert client.get(base, headers=other).status_code == 403


def test_pictures_come_small_and_from_their_folder_only(flight):
    raw = np.zeros((24, 32, 3), np.uint8)
    words = {"kind": "picture", "id": "7", "shape": raw.shape}
    flight.feed.put(words, raw.tobytes(), wait_s=PATIENCE_S)
    flight.set(t_s=300.0)
    base = flight.url.partition("?")[0]
    with httpx.Client(follow_redirects=True) as client, tab(flight) as page:
        page.wait(lambda: shows(page, flight))
        client.get(flight.url)
        for name, size in (("7", (24, 32)), ("1-000001.000.jpg", (45, 640))):
            data = client.get(f"{base}picture/{name}").content
            assert cv2.imdecode(np.frombuffer(data, np.uint8), 1).shape[:2] == size
        ground = client.get(f"{base}result/mosaic.webp")
        assert (ground.content, ground.headers["content-type"]) == (b"the ground", "image/webp")
        for name, status in (("judged.jpg", 204), ("secret.jpg", 404), ("..%2Fsecret.jpg", 404)):
            assert client.get(f"{base}result/{name}").status_code == status
        for name in ("8", "..%2Fsecret.jpg", "poses.csv", ".jpg", "no.jpg"):
            assert client.get(f"{base}picture/{name}").status_code == 404


def test_page_loads_nothing_from_other_hosts(flight):
    with tab(flight) as page:
        assert "a <field>" not in page.html
        without_names = page.html.replace("http://www.w3.org", "")
        assert "http://" not in without_names
        assert "https://" not in without_names


def test_modules_imported_by_scripts_of_the_page_are_served(flight):
    with httpx.Client(follow_redirects=True) as client:
        html = client.get(flight.url).text
        for name in ("flight_map", "flight_board"):
            (path,) = re.findall(rf'"{name}": ?"(/[^"]*)"', html)
            script = client.get(str(httpx.URL(flight.url).join(path))).text
            source = Path(feed.__file__).with_name(f"{name}.js").read_text("utf-8")
            assert script == source


def test_port_in_use_and_foreign_host_are_refused(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OutputError, match=rf"--port: .* port {port} .*in use.*--port 0"):
            feed.bind_port("127.0.0.1", port, "--port")
    with pytest.raises(OutputError, match=r"--page: .* on 192\.0\.2\.1 port 0"):
        feed.bind_port("192.0.2.1", 0, "--page")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UavmapError, match=r"pip install .nicegui>="):
        feed.need_nicegui()


@by(in_real_time)
async def test_hub_shows_the_end_to_all_browsers():
    hub = Hub({"title": "x"})
    hub.enter("a browser")
    waiting = asyncio.create_task(hub.unwatched.wait())
    await hub.receive({"kind": "ended", "text": "over"}, b"")
    await asyncio.sleep(0)
    assert not waiting.done()
    hub.leave("a browser")
    await waiting
    assert hub.ended == "over"


def test_page_that_is_killed_is_reported_once_and_orders_nothing(flight):
    """Keep this test last: it ends the page."""
    feed = flight.feed
    os.kill(feed._child.process.pid, signal.SIGKILL)
    while not feed.dead:
        select.select([feed.orders_file], [], [], PATIENCE_S)
        assert feed.orders() == []
    assert not feed.idle
    assert not any(feed.put({"kind": "delta"}) for _ in range(3))
    assert len(flight.lines) == 4
    assert flight.lines[3].startswith("the live page has ended")
