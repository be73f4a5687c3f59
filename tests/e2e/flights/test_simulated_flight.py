"""`uavmap fly --sim` as a user runs it, its results read by programs of others."""

import json
import shutil
import tomllib
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pyproj
import pytest
import rasterio
import shapely
from pymavlink import mavutil
from shapely.geometry import LineString, Polygon, shape
from shapely.ops import unary_union

from tests.e2e import rig
from tests.support.ground.true_ground import shifts_m, true_ground
from uavmap.output.drawing.mosaic_file import MOSAIC, PLACE, Ground
from uavmap.output.results import flown_of

RESULTS = {"map.geojson", "map.kml", "map.png", "journal.jsonl", "flight.tlog", "summary.json"}
RESULTS |= {"map.gpkg", "report.html", "report.pdf", "judged.jpg", MOSAIC, PLACE, "ortho.tif"}
KEYS = (
    "mission", "strategy", "vehicles", "seed", "completed", "flight_time_s", "makespan_s",
    "distance_m", "sorties", "battery_swaps", "vertices", "tree_depth", "cells_roi", "detections",
    "false_positives", "false_negatives", "cells_missed", "iou_cells", "min_separation_m",
    "fence_breaches", "reserve_violations", "lower_bound_s", "ratio", "bound_makespan_s",
    "bound_held",
)  # fmt: skip
OF_SEVERAL = {"min_separation_m"}
SWATH = ("--strategy", "swath")


def toml(name):
    return tomllib.loads(Path(rig.mission(name)).read_text("utf-8"))


def features(folder, kind):
    found = json.loads((folder / "map.geojson").read_text("utf-8"))["features"]
    return [f for f in found if f["properties"]["kind"] == kind]


def on_ground(geometry, start):
    """Return a geometry in degrees (east, north) as metres on a tangent plane at the start."""
    plane = pyproj.Proj(proj="aeqd", lat_0=start[0], lon_0=start[1], ellps="WGS84")
    return shapely.transform(geometry, lambda xy: np.column_stack(plane(xy[:, 0], xy[:, 1])))


def lon_lat(ring):
    return [(lon, lat) for lat, lon in ring]


def moved(ring, towards_deg, distance_m):
    geod = pyproj.Geod(ellps="WGS84")
    return [geod.fwd(lon, lat, towards_deg, distance_m)[:2] for lat, lon in ring]


def iou(one, other):
    return one.intersection(other).area / one.union(other).area


class TestTiny:
    def test_flight_is_complete_and_right(self, tiny):
        tiny.complete()
        assert tiny.summary["iou_cells"] > 0.75
        assert tiny.summary["vertices"] == tiny.summary["cells_roi"] > 15
        assert tiny.summary["bound_held"] is True

    def test_summary_has_all_documented_keys(self, tiny):
        written = json.loads((tiny.folder / "summary.json").read_text("utf-8"))
        assert {**written, "out": str(tiny.folder)} == tiny.summary
        assert [key for key in KEYS if key not in written] == []
        assert [k for k in KEYS if written[k] is None and k not in OF_SEVERAL] == []
        assert written["seed"] == 1
        assert written["vehicles"] == 1

    def test_folder_has_all_results_and_no_others(self, tiny):
        assert {path.name for path in tiny.folder.iterdir()} == RESULTS

    def test_progress_goes_to_standard_error(self, tiny):
        json.loads(tiny.done.out)  # only the summary
        assert " left  [1: " in tiny.done.err

    def test_outline_lies_over_the_true_region(self, tiny):
        start = toml("tiny")["start"]["position"]
        outline = unary_union([shape(f["geometry"]) for f in features(tiny.folder, "outline")])
        truth = Polygon(lon_lat(toml("tiny")["sim"]["roi"][0]["polygon"]))
        found = iou(on_ground(outline, start), on_ground(truth, start))
        assert found == pytest.approx(tiny.summary["iou_cells"], abs=0.01)

    def test_geojson_is_valid(self, tiny):
        for feature in json.loads((tiny.folder / "map.geojson").read_text("utf-8"))["features"]:
            geometry = shape(feature["geometry"])
            assert geometry.is_valid
            assert not geometry.is_empty
            if geometry.geom_type == "Polygon":
                assert shapely.is_ccw(geometry.exterior)  # RFC 7946, 3.1.6
        cells = features(tiny.folder, "cell")
        explored = [f for f in cells if f["properties"]["state"] == "explored"]
        assert len(explored) == tiny.summary["cells_roi"]
        assert all(f["properties"]["positive"] >= 3 for f in explored)
        assert len(features(tiny.folder, "track")) == 1

    def test_kml_and_picture_open(self, tiny):
        root = ElementTree.parse(tiny.folder / "map.kml").getroot()
        places = root.findall(".//{http://www.opengis.net/kml/2.2}Placemark")
        assert len(places) > tiny.summary["cells_roi"]
        picture = cv2.imread(str(tiny.folder / "map.png"))
        assert picture is not None
        assert picture.std() > 10.0

    def test_mosaic_shows_the_ground_as_the_simulator_paints_it(self, tiny):
        flown = flown_of(tiny.folder)
        ground = Ground.read(tiny.folder, flown.setting.grid)
        truth = true_ground(flown.setting, flown.plan.seed, ground.raster)
        off_m = np.hypot(*shifts_m(ground.image, truth, ground.raster.pitch_m).reshape(-1, 2).T)
        assert np.isfinite(off_m).sum() > 10
        assert np.nanmedian(off_m) < 0.75  # of which a receiver's error is 0.3 m
        seen = ground.image[..., 3] > 0
        dark = [image[seen].mean(axis=1) < 100 for image in (ground.image[..., :3], truth)]
        assert np.mean(dark[0] == dark[1]) > 0.95
        with rasterio.open(tiny.folder / "ortho.tif") as file:
            assert (file.shape, file.crs) == (seen.shape, flown.crs)
            assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
            assert ((file.dataset_mask() > 0) == seen).all()

    def test_report_shows_the_ground(self, tiny):
        text = (tiny.folder / "report.html").read_text("utf-8")
        assert 'href="data:image/webp;base64,' in text

    def test_log_has_the_flight_in_mavlink(self, tiny):
        log = mavutil.mavlink_connection(str(tiny.folder / "flight.tlog"))
        seen, heights, modes, pictures = set(), [], set(), 0
        while (message := log.recv_match()) is not None:
            kind = message.get_type()
            seen.add((kind, message.get_srcSystem()))
            if kind == "GLOBAL_POSITION_INT":
                heights.append(message.relative_alt / 1000.0)
            elif kind == "HEARTBEAT" and message.get_srcComponent() == 1:
                modes.add(message.custom_mode)
            elif kind == "CAMERA_IMAGE_CAPTURED":
                pictures += 1
        log.close()
        assert max(heights) == pytest.approx(12.0, abs=1.0)
        assert abs(heights[-1]) < 0.5
        assert modes >= {4, 9}  # guided, land
        assert pictures >= len(rig.events(tiny.folder, "frame_seen"))
        # both directions are on record
        assert {("COMMAND_LONG", 245), ("COMMAND_INT", 245), ("COMMAND_ACK", 1)} <= seen
        assert not any(kind == "BAD_DATA" for kind, _ in seen)


class TestDeterminism:
    @pytest.mark.parametrize(("fixture", "more"), [("speck", ()), ("speck_passed", SWATH)])
    def test_same_seed_is_the_same_flight_to_the_byte(self, fixture, more, request, tmp_path):
        flight = request.getfixturevalue(fixture)
        folder = tmp_path / "in a folder with blanks" / "and another"
        again = rig.fly("speck", folder, *more, hash_seed="2")
        assert again.summary == {**flight.summary, "out": str(folder)}
        assert rig.bodies(folder) == rig.bodies(flight.folder)
        for name in RESULTS - {"journal.jsonl"}:
            assert (folder / name).read_bytes() == (flight.folder / name).read_bytes(), name

    @pytest.mark.parametrize("fixture", ["speck", "speck_passed"])
    def test_results_made_again_from_the_journal_are_the_same_to_the_byte(
        self, fixture, request, tmp_path
    ):
        flight = request.getfixturevalue(fixture)
        maps = ("map.geojson", "map.kml", "map.gpkg", "map.png")
        anew = (*maps, "summary.json", "report.html", "report.pdf")
        folder = shutil.copytree(
            flight.folder, tmp_path / "anew", ignore=shutil.ignore_patterns(*anew)
        )
        assert rig.uavmap("resume", folder).code == 0
        for name in anew:
            assert (folder / name).read_bytes() == (flight.folder / name).read_bytes(), name

    @pytest.mark.parametrize(("fixture", "more"), [("speck", ()), ("speck_passed", SWATH)])
    def test_another_seed_is_another_flight_to_the_same_place(
        self, fixture, more, request, tmp_path
    ):
        flight = request.getfixturevalue(fixture)
        other = rig.fly("speck", tmp_path, "--seed", 2, *more)
        assert other.summary["seed"] == 2
        assert other.summary["cells_missed"] == flight.summary["cells_missed"] == 0
        assert rig.bodies(tmp_path) != rig.bodies(flight.folder)


class TestPair:
    def test_pair_flies_apart_and_changes_batteries(self, pair):
        pair.complete()
        assert pair.summary["min_separation_m"] >= toml("pair")["team"]["separation_m"]
        swaps = [event["vehicle"] for event in rig.events(pair.folder, "battery_swapped")]
        assert set(swaps) == {1, 2}
        assert pair.summary["battery_swaps"] == len(swaps)
        assert pair.summary["sorties"] == len(rig.events(pair.folder, "airborne")) > 2

    def test_other_vehicle_continues_while_one_changes_its_battery(self, pair):
        frames = {1: [], 2: []}
        seen_meanwhile = 0
        out = {}
        for event in rig.events(pair.folder, "frame_seen", "landed", "battery_swapped"):
            number, other = event["vehicle"], 3 - event["vehicle"]
            if event["kind"] == "frame_seen":
                frames[number].append(event["t_s"])
            elif event["kind"] == "landed":
                out[number] = frames[number][-1]  # from here on it returned
            else:
                seen_meanwhile += sum(out[number] < t_s < event["t_s"] for t_s in frames[other])
        assert seen_meanwhile > 10

    def test_vehicle_after_a_swap_flies_straight_back_to_its_vertex(self, pair):
        order = rig.events(pair.folder, "airborne", "arrived", "battery_swapped", "frame_seen")
        for number in (1, 2):
            mine = [event["kind"] for event in order if event["vehicle"] == number]
            at = mine.index("battery_swapped")
            assert mine[at + 1] == "airborne"
            assert mine[at + 2] == "arrived"  # one leg, without intermediate stops

    def test_tracks_of_both_vehicles_are_drawn(self, pair):
        tracks = features(pair.folder, "track")
        assert {f["properties"]["vehicle"] for f in tracks} == {1, 2}

    def test_vehicles_share_one_map(self, pair):
        looked = {number: set() for number in (1, 2)}
        for event in rig.events(pair.folder, "frame_seen"):
            if len(event["votes"]) > 1:
                looked[event["vehicle"]].add(tuple(event["vantage"]))
        assert min(len(cells) for cells in looked.values()) > 5
        # each cell is observed once: a cell that one has seen is not needed by the other
        assert len(looked[1] & looked[2]) <= 2


class TestDrift:
    def test_flight_is_complete_and_right(self, drift):
        drift.complete()

    def test_map_is_where_the_region_has_drifted_to(self, drift):
        mission_file = toml("drift")
        start, flow = mission_file["start"]["position"], mission_file["drift"]
        (outline,) = features(drift.folder, "outline")
        t_s = outline["properties"]["t_s"]
        ring = mission_file["sim"]["roi"][0]["polygon"]
        there = Polygon(moved(ring, flow["toward_deg"], flow["speed_m_s"] * t_s))
        found = on_ground(shape(outline["geometry"]), start)
        assert iou(found, on_ground(there, start)) == pytest.approx(
            drift.summary["iou_cells"], abs=0.02
        )
        assert iou(found, on_ground(Polygon(lon_lat(ring)), start)) < 0.2  # not where it was

    def test_legs_go_round_the_hole(self, drift):
        mission_file = toml("drift")
        hole = Polygon(lon_lat(mission_file["fence"]["holes"][0]))
        fence = Polygon(lon_lat(mission_file["fence"]["polygon"]))
        lat, lon = mission_file["start"]["position"]
        middle = Polygon(lon_lat(mission_file["search"]["box"])).centroid
        assert LineString([(lon, lat), middle]).intersects(hole)  # else this test shows no drift
        points = [p[:2] for f in features(drift.folder, "track") for p in _points(f)]
        assert len(points) > 100
        track = LineString(points)
        assert not track.intersects(hole)
        assert track.within(fence)


def _points(feature):
    geometry = feature["geometry"]
    lines = geometry["coordinates"]
    return lines if geometry["type"] == "LineString" else [p for line in lines for p in line]


def test_search_that_finds_nothing_is_a_result(tmp_path):
    summary = rig.fly("astray", tmp_path).complete(most_missed=100)
    assert summary["cells_roi"] == summary["vertices"] == 0
    assert summary["cells_missed"] > 0
    assert summary["bound_held"] is None
    assert {path.name for path in tmp_path.iterdir()} == RESULTS
    (outline,) = features(tmp_path, "outline")
    assert outline["geometry"] is None
    times = [event["t_s"] for event in rig.events(tmp_path)]
    assert all(before <= after for before, after in pairwise(times))
