"""The live map for a GIS: its features, and GDAL that reads it from the page's own server."""

import json

import httpx
import pytest
from shapely.geometry import shape

from tests.support.page.board_flight import RING, BoardFlight, record
from tests.support.shown_lines import ShownLines
from uavmap.base.messages import shown_on
from uavmap.ui.page.feed import serve_page
from uavmap.ui.page.live_geojson import geojson, part_of

PATIENCE_S = 30.0


def seen():
    flight = BoardFlight()
    flight.cells("explored", *RING)
    flight.cells("unsure", (1, 1), (8, 8))
    flight.board.set_vehicle(2, record(e=8.0, n=4.0))
    flight.board.set_field("path 2", [1e9, 120.0, 0.0])
    for k in range(3):
        flight.board.add_point(2, 4.0 * k, 4.0)
    return flight


def test_geojson_has_cells_areas_aircraft_and_lines():
    flight = seen()
    found = json.loads(geojson(flight.live(), flight.scene))
    kinds = {}
    for feature in found["features"]:
        kinds.setdefault(feature["properties"]["kind"], []).append(feature)
    assert {kind: len(features) for kind, features in kinds.items()} == {
        "cell": 10, "outline": 1, "unsure": 1, "track": 1, "path": 1, "aircraft": 1,
    }  # fmt: skip
    (region,), (unsure,), (aircraft,) = kinds["outline"], kinds["unsure"], kinds["aircraft"]
    assert (region["properties"]["area_m2"], unsure["properties"]["cells"]) == (128.0, 2)
    assert len(shape(region["geometry"]).interiors) == 1
    assert aircraft["properties"]["height_m"] == 12.0
    # the aircraft is over the middle of the eastern side of the ring
    here = shape(aircraft["geometry"])
    (below,) = [f for f in kinds["cell"] if shape(f["geometry"]).contains(here)]
    place = [below["properties"][name] for name in ("column", "row", "state")]
    assert place == [2, 1, "explored"]
    assert found["bbox"][0] <= here.x <= found["bbox"][2]


def test_geojson_has_aircraft_of_others():
    flight = seen()
    mark = {"name": "DLH1", "e": 8.0, "n": 4.0, "up": None, "words": ""}
    flight.board.set_field("traffic", [mark])
    found = json.loads(geojson(flight.live(), flight.scene))["features"]
    by_kind = {feature["properties"]["kind"]: feature for feature in found}
    other, ours = by_kind["traffic"], by_kind["aircraft"]
    assert (other["properties"]["name"], other["properties"]["height_m"]) == ("DLH1", None)
    assert other["geometry"] == ours["geometry"]


def test_geojson_without_a_region_has_no_geometry_of_it():
    flight = BoardFlight()
    found = json.loads(geojson(flight.live(), flight.scene))
    assert [feature["geometry"] for feature in found["features"]] == [None, None]


@pytest.mark.parametrize("asked", ["", "bytes=-5", "bytes=1-2,3-4", "lines=1-2", "bytes=\u0661-2"])
def test_part_of_an_unusual_request_is_everything(asked):
    assert part_of(b"0123", asked)[0] == 200


def test_part_beyond_the_end_is_refused():
    assert part_of(b"0123", "bytes=4-9")[0] == 416
    assert part_of(b"0123", "bytes=2-") == (206, {"content-range": "bytes 2-3/4"}, b"23")


def test_map_is_read_by_gdal_whole_and_in_parts():
    pytest.importorskip("nicegui", reason="the live page needs the extra page")
    pyogrio = pytest.importorskip("pyogrio")
    lines, flight = ShownLines(), seen()
    with shown_on(lines), serve_page({"title": "x", "steers": False}, 0, "--page") as feed:
        url = lines[1].removeprefix("map for a GIS: ")
        assert httpx.get(url).json()["features"] == []
        feed.put({"kind": "scene", "scene": flight.scene}, wait_s=PATIENCE_S)
        feed.put({"kind": "delta", "delta": flight.board.since(0)}, wait_s=PATIENCE_S)
        while len(httpx.get(url).json()["features"]) < 15:
            pass
        for source in (f"GeoJSON:{url}", url):  # pyogrio reads an address in parts
            assert pyogrio.read_info(source)["crs"] == "EPSG:4326"
            table = pyogrio.read_dataframe(source)
            assert sorted(table["kind"].unique()) == [
                "aircraft", "cell", "outline", "path", "track", "unsure",
            ]  # fmt: skip
        version = flight.board.version
        flight.board.set_vehicle(1, record(n=30.0))
        feed.put({"kind": "delta", "delta": flight.board.since(version)}, wait_s=PATIENCE_S)
        while len(httpx.get(url).json()["features"]) < 16:
            pass
        assert httpx.get(url.replace("token=", "token=x")).status_code == 403
        assert httpx.get(url.replace("map.geojson", "")).status_code == 403
