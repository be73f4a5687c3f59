"""Results in Python: geometries, tables, plots, and errors for damaged folders."""

import io
import json
import sys

import matplotlib as mpl
import pytest
import shapely

import uavmap
from missions.events import Paused
from missions.flight.setting_of import setting_of
from missions.geo.geodesy import Utm, UtmZone
from tests.support.plans import named_text
from tests.unit.test_pages import ROOT
from uavmap.base.terminal import Terminal
from uavmap.load.mission_source import load, mission_of_text
from uavmap.runner.operator.progress import ProgressTable
from uavmap.runner.preflight.plan_figures import default_lines, plan_lines
from uavmap.ui.api.background_job import single

ZONE = UtmZone(32, south=False)
EAST_M, NORTH_M = 500_000.0, 5_300_000.0


def ring(*corners_m):
    places = [ZONE.to_wgs84(Utm(EAST_M + east, NORTH_M + north)) for east, north in corners_m]
    return [[place.lon_deg, place.lat_deg] for place in (*places, places[0])]


def square(east_m, north_m, side_m):
    right, top = east_m + side_m, north_m + side_m
    return ring((east_m, north_m), (right, north_m), (right, top), (east_m, top))


def feature(kind, geometry, coordinates=None, **more):
    shape = None if geometry is None else {"type": geometry, "coordinates": coordinates}
    return {"type": "Feature", "geometry": shape, "properties": {"kind": kind, **more}}


def write(folder, *features, boundary=None):
    folder.mkdir(exist_ok=True)
    collection = {"type": "FeatureCollection", "features": list(features)}
    (folder / "map.geojson").write_text(json.dumps(collection), "utf-8")
    (folder / "summary.json").write_text(
        json.dumps({"completed": True, "finding": "a region of 2 cells"}), "utf-8"
    )
    if boundary is not None:
        told = {"type": "FeatureCollection", "features": boundary}
        (folder / "boundary.geojson").write_text(json.dumps(told), "utf-8")
    return folder


@pytest.fixture
def folder(tmp_path):
    """Write a ring of a region around a hole, two cells, a track, and a boundary with its band."""
    hole = list(reversed(square(4.0, 4.0, 4.0)))
    first = {"state": "explored", "positive": 3, "votes": 5}
    second = {"state": "non-roi", "positive": 0, "votes": 4, "belief": 0.1}
    cells = [
        feature("cell", "Polygon", [square(0, 0, 4)], column=0, row=0, **first),
        feature("cell", "Polygon", [square(4, 4, 4)], column=1, row=1, **second),
    ]
    line = [[*place, 12.0] for place in square(0, 0, 8)[:3]]
    return write(
        tmp_path / "results",
        *cells,
        feature("outline", "Polygon", [square(0, 0, 12), hole], area_m2=128.05, cells=8),
        feature("track", "LineString", line, vehicle=1, start_s=0.0, end_s=9.0),
        boundary=[
            feature("boundary", "MultiPolygon", [[square(1, 1, 10)]]),
            feature("band", "MultiPolygon", [[square(0, 0, 20)]]),
        ],
    )


def test_geometries_are_in_longitude_and_latitude_and_in_metres(folder):
    results = uavmap.open_results(folder)

    assert results.utm_crs == "EPSG:32632"
    assert results.region.bounds == pytest.approx((9.0, 47.85, 9.0, 47.85), abs=0.01)
    assert results.region_utm.area == pytest.approx(144.0 - 16.0, abs=1e-3)
    assert results.region_utm.bounds[:2] == pytest.approx((EAST_M, NORTH_M), abs=1e-6)
    assert results.area_m2 == 128.05
    assert results.boundary is not None
    assert results.to_utm(results.boundary).area == pytest.approx(100.0, abs=1e-3)
    assert [place[2] for place in results.tracks[1].coords] == [12.0] * 3
    assert results.aircraft_down == ()
    assert "2 cells" in repr(results)


def test_cells_are_a_table_with_geometries(folder):
    cells = uavmap.open_results(folder).cells

    assert " ".join(cells.columns) == "column row state positive votes belief geometry"
    assert cells.crs == "EPSG:4326"
    assert cells.to_crs("EPSG:32632").area.tolist() == pytest.approx([16.0, 16.0], abs=1e-3)
    assert cells["belief"].isna().tolist() == [True, False]


def test_plot_shows_cells_outline_boundary_and_track(folder):
    mpl.use("agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415 - after its backend

    axes = uavmap.open_results(folder).plot()

    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        "explored (1)", "not region (1)", "outline of the cells", "boundary by pixels", "track",
    ]  # fmt: skip
    west, east = axes.get_xlim()
    assert west < EAST_M < EAST_M + 12.0 < east < EAST_M + 20.0
    plt.close("all")


@pytest.mark.parametrize(("missing", "name"), [("geopandas", "cells"), ("matplotlib", "plot")])
def test_missing_extra_is_named(folder, missing, name, monkeypatch):
    monkeypatch.setitem(sys.modules, missing, None)
    results = uavmap.open_results(folder)
    with pytest.raises(uavmap.UavmapError, match=f"pip install .{missing}>="):
        results.plot() if name == "plot" else results.cells


def test_map_without_a_region_has_an_empty_one(tmp_path):
    cell = feature("cell", "Polygon", [square(0, 0, 4)], state="non-roi")
    results = uavmap.open_results(
        write(tmp_path / "none", cell, feature("outline", None, area_m2=0.0))
    )
    assert results.region == shapely.Polygon()
    assert results.region_utm.is_empty
    assert results.boundary is None
    assert results.tracks == {}


@pytest.mark.parametrize("text", ["", "[]", '{"features": [1]}', '{"features": [{}]}', "\xff"])
def test_damaged_map_is_named(folder, text):
    (folder / "map.geojson").write_text(text, "latin-1")
    with pytest.raises(uavmap.ResultsError, match=r"map\.geojson: is damaged"):
        uavmap.open_results(folder)


def test_folder_without_results_is_named(tmp_path):
    with pytest.raises(uavmap.ResultsError, match=r"has no map\.geojson"):
        uavmap.open_results(tmp_path)
    with pytest.raises(uavmap.ResultsError, match="no such folder"):
        uavmap.open_results(tmp_path / "other")
    with pytest.raises(uavmap.UavmapError, match="folder = 3"):
        uavmap.open_results(3)


# --- what is raised ------------------------------------------------------------------------------
def test_gravest_error_of_a_group_is_raised_with_the_others_as_notes():
    down, silent = (uavmap.AircraftError("vehicle 1 is down"), uavmap.LinkError("2 is silent"))
    assert single(ExceptionGroup("", [ExceptionGroup("", [silent]), down])) is down
    assert down.__notes__ == ["2 is silent"]
    defect = ExceptionGroup("", [silent, ValueError("a defect")])
    assert single(defect) is defect
    stop = KeyboardInterrupt()
    assert single(BaseExceptionGroup("", [silent, stop])) is stop


# --- simulate ------------------------------------------------------------------------------------
def test_strategies_are_compared_without_flight():
    done = uavmap.simulate(["eden:30:1", "eden:30:2"], strategy=["rdfs", "greedy"], robots=2)
    assert [(run["roi"], run["strategy"]) for run in done.runs] == [
        (roi, name) for roi in ("eden:30:1", "eden:30:2") for name in ("rdfs", "greedy")
    ]
    assert set(done.means) == {"rdfs", "greedy"}
    assert list(done.table["strategy"]) == ["rdfs", "greedy"] * 2


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"strategy": "rdsf"}, "'rdsf' is not known"),
        ({"strategy": ["rdfs", "swath"]}, "cannot be compared"),
        ({"strategy": "swath", "drift": (0.1, 90.0)}, "leave out drift"),
        ({"robots": 0}, "robots = 0"),
        ({"drift": (2.0, 0.0)}, "do not keep up"),
        ({"comms": "radio"}, "comms = 'radio'"),
        ({"strategy": []}, "strategy is empty"),
    ],
)
def test_impossible_simulation_is_an_error(options, expected):
    with pytest.raises(uavmap.UavmapError, match=expected):
        uavmap.simulate("eden:30:1", **options)
    with pytest.raises(uavmap.RoiError, match="roi is empty"):
        uavmap.simulate([])


# --- what is said before a flight ----------------------------------------------------------------
def test_defaults_for_missing_tables_are_listed_in_the_plan():
    text = named_text("runway").text
    begin, end = text.index("[battery]"), text.index("[wind]")
    without = mission_of_text(text[:begin] + text[end:], "without.toml")
    assert default_lines(without) == [
        "[battery] is not in the file; taken: 60 Wh, 300 W in hover, a reserve of 15 %"
    ]
    assert f"  {default_lines(without)[0]}" in plan_lines(setting_of(without))


def test_simulated_flight_without_a_region_has_a_line(tmp_path, capsys):
    text = (ROOT / "tests" / "data" / "speck.toml").read_text("utf-8")
    bare = tmp_path / "bare.toml"
    bare.write_text(text[: text.index("[[sim.roi]]")], "utf-8")
    flight = uavmap.fly(bare, sim=True, out=tmp_path / "out")
    assert "[[sim.roi]] is missing" in capsys.readouterr().err
    assert flight.region.is_empty
    assert "no region found" in flight.finding


def test_stream_that_is_no_terminal_gets_lines_despite_force_color(monkeypatch):
    """A notebook's kernel sets FORCE_COLOR, and cannot move a cursor."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    text = io.StringIO()
    progress = ProgressTable(Terminal(text))
    setting = setting_of(load("runway"))
    progress.begin(setting, again=False)
    progress.update(Paused(1.0), setting.initial_state(), 0)
    progress.end()
    assert "searching" in text.getvalue()
    assert "\x1b" not in text.getvalue()
