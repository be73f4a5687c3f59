"""Cost of a live page for the flight, and the rate at which a browser draws it.

    python -m tests.benchmarks.live_page [--out FOLDER]

20 vehicles, 5,000 cells, and beneath them map tiles and a mosaic that is written anew each second:
first the page by itself, then within the page of `uavmap app`. A picture of each is left in the
folder. The browser is a Chromium without a graphics card.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from missions.events import FrameSeen, Tracked, Vote
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import Phase
from missions.geo.trajectory import rounded_path
from missions.mapping.belief import Belief, FrameId
from missions.mapping.tree import Tree, Vertex
from missions.orders import FlyPath
from missions.units import Cell, GridPoint
from tests.benchmarks.frame import cpu_ms, options_of, spread
from tests.support.page.app_page import app
from tests.support.page.browser import browser
from tests.support.plans import named_text, plan_of
from tests.support.shown_lines import ShownLines
from tests.support.small_missions import first_patch
from tests.unit.uavmap.ui.page.test_page_scene import written
from uavmap.base.framing import SHOWN_IN
from uavmap.base.messages import shown_on
from uavmap.output.drawing.mosaic_file import raster_of, write_mosaic
from uavmap.ui.page.feed import Feed, serve_page
from uavmap.ui.page.page_scene import background_from_tiles, scene_of
from uavmap.ui.page.watching import Watcher
from vision.raster import Raster

VEHICLES, SIDE = 20, 71  # 71 x 71 cells are 5,041
SECONDS = 10.0


def busy() -> tuple[Setting, State]:
    """Return a mission with a large region, half of which is explored."""
    text = f"{first_patch(named_text('runway').text)}\n[team]\nlayer_m = 5.0\n"
    plan = plan_of("runway", text, "rdfs", VEHICLES)
    setting = setting_of(plan.mission)
    state, belief = setting.initial_state(), Belief(5, 3)
    vertices = {}
    for east in range(SIDE):
        for north in range(SIDE):
            cell = Cell(east, north)
            parent = Cell(east, north - 1) if north else Cell(east - 1, 0) if east else None
            vertices[cell] = Vertex(parent, east + north, observed=north < SIDE // 2)
            verdicts = dict.fromkeys(cell.cross(), True)
            for t_s in range(5):
                belief = belief.with_frame(cell, FrameId(1, t_s + 1.0), verdicts)
    vehicles = {
        number: replace(vehicle, phase=Phase.AIRBORNE, landed=False, remaining_wh=40.0)
        for number, vehicle in state.vehicles.items()
    }
    return setting, replace(
        state,
        belief=belief,
        tree=Tree.from_vertices(Cell(0, 0), vertices),
        vehicles=vehicles,
        found_s=0.0,
    )


class Team:
    def __init__(self) -> None:
        self.setting, self.state = busy()
        self.watcher = Watcher(self.state)
        self.watcher.board.set_field("hands_off", "")
        self.step = 0

    def fly(self) -> None:
        """Fly a tenth of a second: two vehicles report, and two judge a picture."""
        self.step += 1
        t_s = round(self.step / 10.0, 3)
        for part in (0, 1):
            number = (2 * self.step + part) % VEHICLES + 1
            angle = t_s / 15.0 + number
            reach_m = 40.0 + 5.0 * number
            place = GridPoint(140 + reach_m * math.sin(angle), 140 + reach_m * math.cos(2 * angle))
            corners = [place, *(GridPoint(140 + 30 * k, 100 + 80 * (k % 2)) for k in range(8))]
            path = rounded_path(corners, t_s, speed_m_s=6.0)  # a new one, each second
            order = FlyPath(path, 12.0, None, 0.5)
            before = self.state.vehicles[number]
            vehicle = replace(before, position=place, height_m=12.0, order=order)
            self.state = replace(self.state.with_vehicle(vehicle), t_s=t_s)
            self.watcher.apply(Tracked(number, t_s, place, 12.0, 40.0), self.state)
            below = self.setting.grid.cell_of(place)
            votes = tuple(Vote(cell, True, 0.9) for cell in below.cross())
            if below in self.state.tree:  # type: ignore[operator]
                tree = self.state.tree.with_observation(below, ())  # type: ignore[union-attr]
                self.state = replace(self.state, tree=tree)
            self.watcher.apply(FrameSeen(number, t_s, below, votes), self.state)


def on_the_flight() -> None:
    team, version, spent_ms = Team(), 0, []

    def show() -> None:
        nonlocal version
        team.watcher.refresh()
        version = team.watcher.board.since(version)["v"]

    for _ in range(400):
        team.fly()
        spent_ms.append(cpu_ms(show))
    share = sum(spent_ms) / 100 / len(spent_ms)
    print(f"telling the page, ten times a second, ms: {spread(spent_ms)}; {share:.1%} of a core")


@contextlib.contextmanager
def day_page(out: Path) -> Iterator[str]:
    """The page of `uavmap app`; live pages that begin meanwhile may be shown within it."""
    folder = out / "fields"
    folder.mkdir(exist_ok=True)
    with app(folder) as (_, url):
        os.environ[SHOWN_IN] = url.partition("/?")[0]
        try:
            yield url
        finally:
            del os.environ[SHOWN_IN]


def open_within(driver: Any, url: str) -> None:
    """Show a page over the page of the day, as that does it."""
    frame = driver.find_element("css selector", ".app-frame-page")
    show = "arguments[0].closest('.app-frame').classList.remove('hidden');"
    driver.execute_script(show + "arguments[0].src = arguments[1]", frame, url)
    driver.switch_to.frame(frame)


def in_the_browser(out: Path, day_url: str = "") -> None:
    lines = ShownLines()
    config = {"title": "20 vehicles, 5,000 cells", "steers": True, "folder": str(out.resolve())}
    with shown_on(lines), serve_page(config, 0, "--page") as feed, browser() as driver:
        team = Team()
        ground = grow_mosaic(out, team.setting, 0)
        tiles = out / "field.mbtiles"
        tiles.unlink(missing_ok=True)
        beneath = background_from_tiles(written(tiles, team.setting.mission.home), team.setting)
        scene = scene_of(team.setting, beneath, ground)
        feed.put({"kind": "background"}, beneath.jpeg, wait_s=5.0)
        feed.put({"kind": "scene", "scene": scene}, wait_s=5.0)
        driver.get(day_url or lines.page)
        begin = (lambda: open_within(driver, lines.page)) if day_url else lambda: None
        version = run_updates(team, feed, 0, 4.0, begin)
        assert driver.execute_script("return !!flightMap.mosaic && !!flightMap.background")
        count = "window.ticks = 0; (function t() { ticks += 1; requestAnimationFrame(t) })();"
        driver.execute_script(count)
        read = "return [flightMap.frames, flightMap.drawn_ms, ticks, flightMap.board.cells.size]"
        before: list[Any] = driver.execute_script(read)
        begin_s = time.monotonic()
        run_updates(team, feed, version, SECONDS, lambda: None, out)
        after = driver.execute_script(read)
        elapsed_s = time.monotonic() - begin_s
        drawn = after[0] - before[0]
        print(
            f"{'within the app' if day_url else 'alone'}: {after[3]} cells, {VEHICLES} vehicles, "
            f"tiles, a mosaic of {ground.columns} x "
            f"{ground.rows} px: drawn {drawn / elapsed_s:.0f} times a second, "
            f"{(after[1] - before[1]) / max(drawn, 1):.1f} ms each; the browser's own frames: "
            f"{(after[2] - before[2]) / elapsed_s:.0f} a second"
        )
        driver.save_screenshot(str(out / f"live-page-20{'-app' if day_url else ''}.png"))


def grow_mosaic(out: Path, setting: Setting, step: int) -> Raster:
    """Write a mosaic over all the fence, of which each step shows more; return its path."""
    raster = raster_of(setting)
    assert raster is not None
    rng, size = np.random.default_rng(0), (raster.columns, raster.rows)
    image = rng.integers(0, 256, (raster.rows // 8, raster.columns // 8, 4), np.uint8)
    image = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC)
    image[..., 3] = 255
    image[raster.rows * (step + 4) // 16 :] = 0
    write_mosaic(out, image, raster, setting.grid)
    return raster


def run_updates(
    team: Team, feed: Feed, version: int, seconds: float, act: Any, out: Path | None = None
) -> int:
    """Fly and report for a while; call `act` at the beginning. `out` has the growing mosaic."""
    begin_s, step = time.monotonic(), 0
    act()
    while (now_s := time.monotonic()) - begin_s < seconds:
        team.fly()
        team.watcher.refresh()
        if feed.idle:
            delta = team.watcher.board.since(version)
            if feed.put({"kind": "delta", "delta": delta}):
                version = delta["v"]
        if out is not None and now_s - begin_s > step:
            grow_mosaic(out, team.setting, step := step + 1)
        time.sleep(max(0.1 - (time.monotonic() - now_s), 0.0))
    return version


if __name__ == "__main__":
    on_the_flight()
    folder = options_of(__doc__, out=Path()).out
    in_the_browser(folder)
    with day_page(folder) as day_url:
        in_the_browser(folder, day_url)
