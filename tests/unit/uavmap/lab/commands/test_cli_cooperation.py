"""`uavmap simulate --cooperate`: files of polygons, figures, pictures and refusals."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from PIL import Image

from missions.errors import AreaError
from uavmap.lab.commands.cooperation import read_polygon_file
from uavmap.ui.cli import main

WKT = "POLYGON ((0 0, 30 0, 30 12, 18 12, 18 20, 0 20, 0 0), (5 5, 9 5, 9 9, 5 9, 5 5))"
AREA_M2 = 30 * 12 + 18 * 8 - 16


@pytest.fixture
def hall(tmp_path: Path) -> Path:
    path = tmp_path / "hall.wkt"
    path.write_text(WKT)
    return path


def run(hall, *options):
    return main(["simulate", "--polygon", str(hall), *map(str, options)])


@pytest.mark.parametrize(
    ("mode", "options", "robots", "cover"),
    [
        ("trapezoid", ["--range", 8], 2, "triangles"),
        ("trapezoid", ["--range", 8, "--theta", 45, "--cover", "diamonds"], 2, "diamonds"),
        ("triangulation", ["--range", 40], 2, None),
        ("column", ["--range", 5, "--robots", 4], 4, None),
    ],
)
def test_hall_is_mapped_whole(hall, capsys, mode, options, robots, cover):
    arguments = ["--cooperate", mode, *options, "--seed", 7, "--json"]
    assert run(hall, *arguments) == 0
    text = capsys.readouterr().out
    found = json.loads(text)
    assert found["complete"] is True
    assert (found["robots"], found["cover"], found["seed"]) == (robots, cover, 7)
    assert found["mapped_m2"] == pytest.approx(AREA_M2)
    assert (found["missed_m2"], found["points_unseen"]) == (0.0, 0)
    assert found["points_looked_at"] >= 400
    assert found["path_m"] > found["known_path_m"] > 0
    assert [end["robot"] for end in found["final_places"]] == list(range(1, robots + 1))
    for end in found["final_places"]:
        assert end["watched"]["sigma_m"] < end["alone"]["sigma_m"]
        ellipse = end["watched"]
        assert 0 < ellipse["ellipse_minor_m"] <= ellipse["ellipse_major_m"]
    assert run(hall, *arguments) == 0
    assert capsys.readouterr().out == text


def test_another_seed_gives_other_errors_on_the_same_path(hall, capsys):
    found = []
    for seed in (1, 2):
        run(hall, "--cooperate", "trapezoid", "--range", 8, "--seed", seed, "--json")
        found.append(json.loads(capsys.readouterr().out))
    assert found[0]["path_m"] == found[1]["path_m"]
    assert found[0]["final_places"] != found[1]["final_places"]


def test_cooperation_writes_its_files_and_a_film(hall, tmp_path, capsys):
    out, film = tmp_path / "out", tmp_path / "film.gif"
    options = ["--cooperate", "trapezoid", "--range", 10, "--start", "0,20"]
    assert run(hall, *options, "--out", out, "--animate", film) == 0
    assert "exchanges" in capsys.readouterr().out
    summary = json.loads((out / "summary.json").read_text())
    assert summary["start_m"] == [0.0, 20.0]
    with (out / "moves.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["robot"] for row in rows} == {"1", "2"}
    assert (float(rows[0]["east_m"]), float(rows[0]["north_m"])) == (0.0, 20.0)
    with Image.open(out / "map.png") as picture:
        assert picture.width > 400
        colours = picture.convert("RGB").getcolors(1_000_000)
        assert colours is not None
        assert len(colours) > 5
    with Image.open(film) as moving:
        assert moving.n_frames > 20
    assert run(hall, *options, "--out", out) == 2
    assert "already has a summary.json; choose" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--range", "9"], "--polygon needs --cooperate"),
        (["--cooperate", "column"], "--polygon needs --range"),
        (
            ["--cooperate", "column", "--range", "9", "--robots", "2"],
            "two are for --cooperate trap",
        ),
        (
            ["--cooperate", "trapezoid", "--range", "9", "--robots", "3"],
            "are for --cooperate column",
        ),
        (["--cooperate", "column", "--range", "9", "--robots", "6"], "column takes 3 to 5"),
        (["--cooperate", "triangulation", "--range", "9"], "m wide, the range is 9 m"),
        (["--cooperate", "triangulation", "--range", "99", "--theta", "40"], "--theta is for stri"),
        (["--cooperate", "column", "--range", "9", "--cover", "diamonds"], "--cover is for"),
        (["--cooperate", "trapezoid", "--range", "9", "--strategy", "rdfs"], "--strategy is for"),
        (["--cooperate", "trapezoid", "--range", "9", "--drift", "1,2"], "--drift is for"),
        (["--cooperate", "trapezoid", "--range", "9", "--index", "2"], "--index is for ROIs"),
        (["--cooperate", "trapezoid", "--range", "9", "--start", "6,6"], "is not in the area"),
        (["--cooperate", "trapezoid", "--range", "9", "--start", "x"], "EAST,NORTH in metres"),
    ],
)
def test_options_that_do_not_go_together_are_refused(hall, capsys, options, expected):
    assert run(hall, *options) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("option", [["--range", "9"], ["--cooperate", "column"], ["--theta", "9"]])
def test_options_of_cooperation_are_refused_without_it(capsys, option):
    assert main(["simulate", "--roi", "eden:20:1", *option]) == 2
    assert "is for --polygon FILE" in capsys.readouterr().err


# --- files --------------------------------------------------------------------------------------
def test_json_file_in_metres_is_read(tmp_path):
    path = tmp_path / "a.json"
    ring, hole = [[0, 0], [4, 0], [4, 4], [0, 4]], [[1, 1], [2, 1], [2, 2]]
    path.write_text(json.dumps({"polygon_m": ring, "holes_m": [hole]}))
    ground = read_polygon_file(str(path))
    assert ground.space.area_m2 == pytest.approx(15.5)
    assert ground.plane is None


def test_geojson_file_keeps_its_hole_and_keep_out_zone(tmp_path):
    def square(west, south, size):
        step = size / 111_195  # about a metre at the equator, both ways
        x, y = west / 111_195, south / 111_195
        return [[x, y], [x + step, y], [x + step, y + step], [x, y + step], [x, y]]

    def feature(name, *rings):
        geometry = {"type": "Polygon", "coordinates": rings}
        return {"type": "Feature", "properties": {"name": name}, "geometry": geometry}

    path = tmp_path / "area.geojson"
    features = [
        feature("yard", square(0, 0, 40), square(10, 10, 5)),
        feature("keep-out", square(30, 20, 4)),
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    ground = read_polygon_file(str(path))
    assert len(ground.space.rings) == 3
    assert ground.space.area_m2 == pytest.approx(1600 - 25 - 16, rel=0.01)
    assert ground.plane is not None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("POLYGON ((0 0, 1 0", "not WKT"),
        ("POLYGON EMPTY", "no polygon"),
        ("POLYGON ((0 0, 4 4, 4 0, 0 4, 0 0))", "not a polygon"),
        ('{"polygon_m": [[0, 0], [1]]}', r"polygon_m\[1\] = \[1\]: expected \[east, north\]"),
        ('{"polygon_m": 5}', r"polygon_m\[0\] = 5"),
        ('{"name": "polygon_m"}', r"polygon_m\[0\] = null"),
        ('{"polygon_m": [[0, 0], [1, 0], [0, 1]], "holes_m": 3}', "holes_m: expected"),
        ('{"polygon_m": ', "not JSON"),
        ("nothing", "unknown kind of file"),
    ],
)
def test_file_that_is_no_polygon_is_named(tmp_path, text, expected):
    path = tmp_path / "a.wkt"
    path.write_text(text)
    with pytest.raises(AreaError, match=expected) as raised:
        read_polygon_file(str(path))
    assert str(raised.value).startswith(str(path))


def test_missing_file_is_named(tmp_path):
    with pytest.raises(AreaError, match=r"b\.wkt: cannot be read"):
        read_polygon_file(str(tmp_path / "b.wkt"))
