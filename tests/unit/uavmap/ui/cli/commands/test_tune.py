"""`uavmap tune` from pictures and examples to a detector that `replay` maps with."""

import json
import math
import shutil
import sys

import numpy as np
import pytest
from PIL import Image

from missions.errors import ImageError, MissionFileError
from missions.units import LatLon
from tests.benchmarks.photos import brighton
from tests.benchmarks.photos.detectors import judged
from tests.support.models import all_familiar
from tests.support.small_missions import START, ring, square
from tests.unit.uavmap.photos.test_replay import (
    GEOD,
    GRID,
    HEIGHT,
    ROI,
    UP_M,
    WIDTH,
    paint,
    painted,
)
from uavmap.load.detector_source import KEPT
from uavmap.load.mission_source import load
from uavmap.output.facts.map_model import NOT_ROI
from uavmap.photos.tune.examples import Example, load_examples
from uavmap.photos.tune.selection import dealt, total
from uavmap.photos.tune.training import PictureFeatures, fit_trees, variants
from uavmap.photos.tune.tune_job import DETECTOR, MODEL, OVERLAYS, REPORT, TuneSettings, learn
from uavmap.ui.cli import main
from vision.detectors.learned_model import LearnedDetector, Model, Scorer, model_bytes, read_model

WIDE = 320
SMALL = ["--width", str(WIDE), "--cell-px", "18", "--features", "color"]


def place(east_m, north_m):
    azimuth_deg = math.degrees(math.atan2(east_m, north_m))
    lon, lat, _ = GEOD.fwd(START.lon_deg, START.lat_deg, azimuth_deg, math.hypot(east_m, north_m))
    return LatLon(lat, lon)


def region_file(path, kind="region"):
    west, east, south, north = ROI
    corners = [(west, south), (east, south), (east, north), (west, north), (west, south)]
    outline = [[p.lon_deg, p.lat_deg] for p in (place(*corner) for corner in corners)]
    geometry = {"type": "Polygon", "coordinates": [outline]}
    feature = {"type": "Feature", "properties": {"kind": kind}, "geometry": geometry}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


def mission_file(path):
    path.write_text(f"""
start.position = [{START.lat_deg}, {START.lon_deg}]
search.box = {ring(GRID, square(-10, -10, 60, 50))}
fence.polygon = {ring(GRID, square(-30, -30, 100, 90))}
flight.altitude_m = {UP_M}
camera = {{width_px = {WIDTH}, height_px = {HEIGHT}, mounting = "gimbal", pixels_per_cell = 20}}
detector = {{view = "all"}}
votes = {{frames = 3, positive = 2}}
""")
    return path


def found_share(out, cell_m):
    features = json.loads((out / "map.geojson").read_text())["features"]
    cells = [f["properties"] for f in features if f["properties"]["kind"] == "cell"]
    west, east, south, north = ROI
    roi_m2 = cell_m**2 * sum(cell["state"] not in NOT_ROI for cell in cells)
    return float(roi_m2 / ((east - west) * (north - south)))


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """Make a folder with photographs, polygons, a mission, and the detector learned from them."""
    folder = tmp_path_factory.mktemp("tuned")
    images = painted(folder / "images")
    polygons = region_file(folder / "region.geojson")
    arguments = ["tune", str(images), "--examples", str(polygons), "--out", str(folder / "eyes")]
    assert main([*arguments, *SMALL]) == 0
    mission_file(folder / "field.toml")
    return folder


def test_detector_is_learned_from_polygons_and_maps_the_region(tuned, tmp_path):
    report = json.loads((tuned / "eyes" / REPORT).read_text())
    assert report["cells"]["iou"] > 0.9
    assert report["pixels"]["precision"] > 0.9
    assert len(report["pictures"]) == 4
    assert sorted(p.name for p in (tuned / "eyes" / OVERLAYS).iterdir()) == [
        f"{number}.jpg" for number in range(4)
    ]
    out = tmp_path / "map"
    arguments = ["--mission", str(tuned / "field.toml"), "--detector", str(tuned / "eyes")]
    assert main(["replay", str(tuned / "images"), *arguments, "--out", str(out)]) in (0, 3)
    assert 0.7 < found_share(out, GRID.cell_m) < 1.3


def test_masks_teach_like_polygons_and_the_same_seed_gives_the_same_bytes(tuned, tmp_path):
    masks = tmp_path / "masks"
    masks.mkdir()
    for example in load_examples(tuned / "images", tuned / "region.geojson", WIDE):
        Image.fromarray(example.region.astype(np.uint8) * 255).save(masks / f"{example.name}.png")
    arguments = ["tune", str(tuned / "images"), "--examples", str(masks), *SMALL]
    assert main([*arguments, "--out", str(tmp_path / "again")]) == 0
    for name in (MODEL, DETECTOR, REPORT):
        assert (tmp_path / "again" / name).read_bytes() == (tuned / "eyes" / name).read_bytes()


def test_mission_that_is_flown_holds_the_checksum_of_its_model(tuned, tmp_path):
    folder = tmp_path / "eyes"
    folder.mkdir()
    for name in (MODEL, DETECTOR):
        (folder / name).write_bytes((tuned / "eyes" / name).read_bytes())
    mission = load(str(tuned / "field.toml"), str(folder))
    section = mission.detector
    assert (section.name, section.view) == ("learned", "all")
    assert section.model == str((folder / MODEL).resolve())
    (folder / MODEL).write_bytes((folder / MODEL).read_bytes() + b" ")
    from uavmap.aircraft.imaging.classifier import detector_of  # noqa: PLC0415

    with pytest.raises(MissionFileError, match="has changed since the mission began"):
        detector_of(mission)


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (lambda data: data[:200], "damaged"),
        (lambda data: b"\x80\x04\x95", "damaged"),
        (lambda data: b'{"format": "other"}', "not a detector's model"),
        (lambda data: data.replace(b'"version":4', b'"version":9'), "version 9"),
        (lambda data: data.replace(b'"bias"', b'"bios"'), "damaged"),
        (lambda data: data.replace(b'"light"', b'"leight"', 1), "unknown feature 'leight'"),
    ],
)
def test_damaged_or_foreign_model_is_refused_in_a_line(tuned, tmp_path, refused, damage, why):
    assert callable(damage)
    folder = tmp_path / "eyes"
    folder.mkdir()
    (folder / DETECTOR).write_bytes((tuned / "eyes" / DETECTOR).read_bytes())
    (folder / MODEL).write_bytes(damage((tuned / "eyes" / MODEL).read_bytes()))
    arguments = ("--mission", tuned / "field.toml", "--detector", folder)
    line = refused("replay", tuned / "images", *arguments, "--out", tmp_path / "m")
    assert why in line
    assert str(folder / MODEL) in line


def test_faulty_examples_are_refused_with_a_reason(tuned, tmp_path):
    images = tuned / "images"
    where = tmp_path / "masks"
    with pytest.raises(ImageError, match="no folder of masks"):
        load_examples(images, where, WIDE)
    where.mkdir()
    with pytest.raises(ImageError, match=r"paint some, for example 0\.png"):
        load_examples(images, where, WIDE)
    (where / "1.png").write_bytes(b"no picture")
    with pytest.raises(ImageError, match=r"1\.png: not a readable picture \(no JPEG, PNG"):
        load_examples(images, where, WIDE)


def test_single_painted_picture_is_refused(tuned, tmp_path, refused):
    mask = np.zeros((90, 160), np.uint8)
    mask[:40] = 255
    where = tmp_path / "masks"
    where.mkdir()
    Image.fromarray(mask).save(where / "0.png")
    arguments = ("tune", tuned / "images", "--examples", where, *SMALL)
    assert "paint at least two" in refused(*arguments, "--out", tmp_path / "eyes")


def test_polygons_teach_in_the_pictures_that_can_be_read(tuned, tmp_path):
    images, told = tmp_path / "images", []
    shutil.copytree(tuned / "images", images)
    data = (images / "1.jpg").read_bytes()
    (images / "1.jpg").write_bytes(data[: len(data) // 2])
    examples = load_examples(images, tuned / "region.geojson", WIDE, told.append)
    assert [example.name for example in examples] == ["0", "2", "3"]
    (line,) = told
    assert line.startswith(f"left out: {images / '1.jpg'}")


def test_variants_show_the_same_ground_in_other_light():
    picture = np.asarray(paint(10.0, 10.0, 0.0))
    region = picture[:, :, 0] < 140
    example = Example("x", picture, region.astype(np.uint8))
    for variant in variants(example, np.random.default_rng(3), 4):
        assert not np.array_equal(variant.picture, picture)
        levels = variant.picture[:, :, 1].astype(float)
        gap = levels[~variant.region].mean() - levels[variant.region].mean()
        assert gap > 3 * levels[variant.region].std()


def test_trees_answer_as_the_learner_does_and_survive_their_file():
    rng = np.random.default_rng(5)
    values = rng.normal(size=(4000, 3)).astype(np.float32)
    labels = (values[:, 0] * values[:, 1] > 0.2) | (values[:, 2] > 1.0)
    parts = fit_trees(values, labels, 1)  # it checks its answers against the learner's
    model = Model(features=("light", "red_green", "detail"), parts=(parts,), **all_familiar())
    again = read_model(model_bytes(model), "x")
    assert model_bytes(again) == model_bytes(model)
    columns = np.ascontiguousarray(values.T)
    found = Scorer(again.parts).probability(columns)
    assert np.array_equal(found, Scorer(model.parts).probability(columns))
    assert ((found > 0.5) == labels).mean() > 0.95


def test_tune_without_the_learner_names_the_extra(tuned, tmp_path, monkeypatch, refused):
    monkeypatch.setitem(sys.modules, "sklearn", None)
    arguments = ("tune", tuned / "images", "--examples", tuned / "region.geojson")
    line = refused(*arguments, "--out", tmp_path / "eyes")
    assert "pip install 'scikit-learn>=" in line


@pytest.mark.skipif(not brighton.there(), reason="the photographs of Brighton Beach are not here")
def test_road_is_learned_from_three_real_photographs():
    names = brighton.names()
    painted = brighton.examples([names[i] for i in (2, 7, 12)])
    settings = TuneSettings(kinds=("logistic",), sets=("color and texture",))
    model, choice, *_ = learn(painted, [], settings, lambda _: None)
    detector = LearnedDetector(model)
    others = brighton.examples([names[i] for i in (0, 5, 10, 15)])
    cells = total([judged(detector, example, choice.share)[1] for example in others])
    assert cells.iou > 0.62


def test_learned_detector_maps_without_a_mission_file(tuned, tmp_path, capsys):
    out, eyes = tmp_path / "map", str(tuned / "eyes")
    photos = str(tuned / "images")
    assert main(["replay", photos, "--detector", eyes, "--out", str(out)]) in (0, 3)
    made = load(str(out / "mission.toml"))
    assert (made.detector.name, made.detector.view) == ("learned", "all")
    assert made.detector.model == str((out / KEPT / MODEL).resolve())  # its copy
    assert 0.7 < found_share(out, made.grid.cell_m) < 1.3
    seen = ["look", str(tuned / "images" / "0.jpg"), "--out", str(tmp_path / "seen.png"), "--json"]
    capsys.readouterr()
    assert main([*seen, "--detector", eyes]) == 0
    learned_share = json.loads(capsys.readouterr().out)["roi_share"]
    assert main([*seen, "--detector", eyes, "--mission", str(tuned / "field.toml")]) == 0
    assert json.loads(capsys.readouterr().out)["roi_share"] == pytest.approx(learned_share, abs=0.1)
    assert main(seen) == 0
    assert (
        json.loads(capsys.readouterr().out)["roi_share"] > learned_share + 0.2
    )  # not one colour is green


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (None, "cannot be read"),
        ('name = "learned"\nmodel = "gone.json"', "gone.json"),
        ('name = "learnt"', "detector.name is 'learnt'"),
        ('name = "paved"\nshare = 2', "detector.share = 2: input should be"),
    ],
)
@pytest.mark.parametrize("command", ["replay", "look"])
def test_detector_is_checked_before_any_picture(tmp_path, refused, text, why, command):
    if text is not None:
        (tmp_path / DETECTOR).write_text(f"[detector]\n{text}\n")
    line = refused(command, tmp_path / "no pictures", "--detector", tmp_path)
    assert line.startswith(f"uavmap: --detector {tmp_path}: ")
    assert why in line


def described_as(name, *, region, surround):
    share = np.array([1.0 if region else 0.0, 0.0 if surround else 1.0], np.float32)
    known = np.array([region, surround])
    numbers = (share > 0.5).astype(np.uint8)
    plain = PictureFeatures(name, np.zeros((1, 2), np.float32), share, known, numbers, 1, 2)
    return (plain,)


@pytest.mark.parametrize(
    "kinds", ["bssssb", "brrrrb", "rrss", "bbbbbbb", "sssssssrr", "rrrrrrrss", "r-s-rs--"]
)
def test_folds_of_training_contain_both_kinds(kinds):
    """Few of many pictures show the region, and stand where a simple split puts them together."""
    more = {"b": (True, True), "r": (True, False), "s": (False, True), "-": (False, False)}
    pictures = [
        described_as(str(i), region=more[kind][0], surround=more[kind][1])
        for i, kind in enumerate(kinds)
    ]
    judged = []
    for learned_from, out in dealt(pictures):
        assert sorted([*learned_from, *out]) == list(range(len(kinds)))
        judged += out
        seen = [more[kinds[i]] for i in learned_from]
        assert any(region for region, _ in seen)
        assert any(surround for _, surround in seen)
    assert sorted(judged) == list(range(len(kinds)))


def test_trees_answer_alike_where_many_values_lie_on_their_borders():
    rng = np.random.default_rng(2)
    levels = np.log(rng.integers(1, 40, (6000, 2)) / 7.0).astype(np.float32)
    levels += rng.choice([0.0, 1e-7, 3e-7], (6000, 2)).astype(np.float32)
    labels = levels[:, 0] > levels[:, 1]
    parts = fit_trees(levels, labels, 1)  # it checks its answers against the learner's
    assert any(at not in (0.0, round(at, 6)) for tree in parts.trees for at in tree.at_most)
