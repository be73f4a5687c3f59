"""Tiles of an online map, from a server on loopback that counts its requests."""

from __future__ import annotations

import http.server
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest

from missions.units import LatLon
from uavmap.load.map_tiles import Bounds, Tile
from uavmap.load.mbtiles import Tiles
from uavmap.ui.cli import main

PNG = cv2.imencode(".png", np.full((256, 256, 3), 120, np.uint8))[1].tobytes()


class Maps:
    """A source of tiles; it answers `broken` tiles with an error, `odd` ones with no picture."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.agents: set[str] = set()
        self.broken_after: int | None = None
        self.odd = False
        maps = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                maps.asked.append(self.path)
                maps.agents.add(self.headers["User-Agent"])
                if maps.broken_after is not None and len(maps.asked) > maps.broken_after:
                    self.send_error(503)
                    return
                self.send_response(200)
                self.end_headers()
                self.wfile.write(b"<html>" if maps.odd else PNG)

            def log_message(self, *_: object) -> None: ...

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/{{z}}/{{x}}/{{y}}.png"


@pytest.fixture
def maps() -> Iterator[Maps]:
    made = Maps()
    thread = threading.Thread(target=made.server.serve_forever)
    thread.start()
    yield made
    made.server.shutdown()
    thread.join()
    made.server.server_close()


def tiles(maps: Maps, out: Path, *more: str) -> int:
    source = ["--source", maps.url, "--attribution", "(c) nobody"]
    return main(["tiles", "runway", "--out", str(out), *source, "--zoom", "16-17", *more])


def test_tiles_of_a_mission_are_kept_and_shown(maps, tmp_path, capsys):
    out = tmp_path / "field.mbtiles"
    assert tiles(maps, out) == 0
    count = len(maps.asked)
    assert 2 <= count <= 20
    assert len(set(maps.asked)) == count
    assert maps.agents == {next(iter(maps.agents))}
    assert next(iter(maps.agents)).startswith("uavmap/")
    assert f"{count} tiles fetched, {count} of {count}" in capsys.readouterr().err
    shown = Tiles(out)
    zoom, x, y = (int(part) for part in maps.asked[-1].removesuffix(".png").split("/")[1:])
    assert shown.tile(zoom, x, y) == PNG
    assert shown.middle == pytest.approx((37.1977, -80.578), abs=0.01)
    assert shown.attribution == "(c) nobody"
    # again: no request is made
    assert tiles(maps, out) == 0
    assert len(maps.asked) == count
    assert "0 tiles fetched" in capsys.readouterr().err


def test_file_of_tiles_is_opened_by_gdal(maps, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    out = tmp_path / "field.mbtiles"
    assert tiles(maps, out) == 0
    with rasterio.open(out) as file:
        assert file.driver == "MBTiles"
        assert file.crs.to_epsg() == 3857
        assert int(file.read(1).max()) == 120


def test_source_that_failed_is_asked_for_the_missing_tiles_only(maps, tmp_path, capsys):
    out = tmp_path / "field.mbtiles"
    maps.broken_after = 2
    assert tiles(maps, out) == 2
    assert "the source answers 503" in capsys.readouterr().err
    maps.broken_after = None
    asked = len(maps.asked)
    assert tiles(maps, out) == 0
    with closing(sqlite3.connect(out)) as database:
        (total,) = database.execute("SELECT count(*) FROM tiles").fetchone()
    assert len(maps.asked) - asked == total - 2


def test_answer_that_is_no_picture_is_refused(maps, tmp_path, capsys):
    maps.odd = True
    assert tiles(maps, tmp_path / "field.mbtiles") == 2
    assert "is not a picture" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--source", "ftp://x/{z}/{x}/{y}"], "begins with https"),
        (["--source", "https://x/{z}/{x}.png"], "has no {y}"),
        (["--zoom", "14-22"], "at most 5000 are fetched; --zoom 14-"),
    ],
)
def test_faulty_options_are_refused_before_any_request(maps, tmp_path, capsys, words, message):
    assert tiles(maps, tmp_path / "x.mbtiles", *words) == 2
    assert message in capsys.readouterr().err
    assert not maps.asked


def test_file_of_another_source_is_left_alone(maps, tmp_path, capsys):
    out = tmp_path / "field.mbtiles"
    assert tiles(maps, out) == 0
    before = out.read_bytes()
    assert tiles(maps, out, "--source", maps.url.replace(".png", ".jpg")) == 2
    assert "choose another file" in capsys.readouterr().err
    assert out.read_bytes() == before


def test_tiles_over_the_edge_of_the_world_are_listed():
    fiji = Bounds.around([LatLon(-17.0, 179.9995), LatLon(-17.0, 180.0)])
    found = fiji.tiles(10)
    assert {tile.x for tile in found} == {1023, 0}
    assert Tile(10, 0, found[0].y) in found
    pole = Bounds.around([LatLon(89.0, 0.0)])
    assert all(0 <= tile.y < 4 for tile in pole.tiles(2))
