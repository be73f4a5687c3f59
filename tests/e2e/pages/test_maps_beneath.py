"""Every kind of map file lies beneath the live page: seen in a real browser, pixel by pixel."""

from __future__ import annotations

from missions.flight.setting_of import setting_of
from tests.e2e import rig
from tests.e2e.pages.test_page import Page
from tests.support.page.browser import browser, need_browser
from tests.support.shown_lines import ShownLines
from tests.unit.uavmap.ui.ground.test_layers import PITCH_M, cog, geotiff, mbtiles, mosaic, pmtiles
from uavmap.base.messages import shown_on
from uavmap.load.mission_source import load
from uavmap.ui.page.feed import serve_page
from uavmap.ui.page.page_scene import background_from_tiles, scene_of

PLACES = ((60, 20), (120, 130), (180, 60), (150, 150))
"""Columns and rows of the ground."""
LOSSY = 20
"""Difference of a gray value after two compressions."""
FAR = "flightMap.zoom(0.25, flightMap.canvas.width / 2, flightMap.canvas.height / 2)"
SEEN = (
    "(([x, y]) => [...flightMap.base.getContext('2d').getImageData(x, y, 1, 1).data])"
    "(flightMap.at({}, {}))"
)


def test_live_page_any_kind_of_map_file_shows_each_place_in_its_colour(tmp_path):
    need_browser()
    setting, said = setting_of(load(rig.mission("speck"))), ShownLines()
    config = {"title": "speck", "steers": False}
    with shown_on(said), serve_page(config, 0, "--page") as feed, browser() as driver:
        page = Page(driver)
        for make in (geotiff, cog, mbtiles, pmtiles, mosaic):
            folder = tmp_path / make.__name__
            folder.mkdir()
            ground = background_from_tiles(make(folder), setting)  # as `--tiles FILE` does
            scene = scene_of(setting, ground) | {"mission": make.__name__}
            assert feed.put({"kind": "background"}, ground.jpeg, wait_s=5.0)
            assert feed.put({"kind": "scene", "scene": scene}, wait_s=5.0)
            driver.get(said.page)
            page.wait(
                f"flightMap.scene?.mission === '{make.__name__}' && flightMap.background"
                " && flightMap.frames && !flightMap.stale"
            )
            page.shows(FAR)
            page.wait("!flightMap.stale")
            for column, row in PLACES:
                at = PITCH_M * column - 50.0, 50.0 - PITCH_M * row
                red, green, *_ = page.shows(SEEN.format(*at))
                assert abs(red - column) <= LOSSY, (make.__name__, column, row)
                assert abs(green - row) <= LOSSY, (make.__name__, column, row)
        assert not [each for each in driver.get_log("browser") if each["level"] == "SEVERE"]
