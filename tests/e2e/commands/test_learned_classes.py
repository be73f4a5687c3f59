"""Photographs of four classes: painted by number, learned, mapped by class with litres."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from tests.support.ground import sites
from uavmap.ui.cli import main

MIN_IOU = 0.8


@pytest.fixture(scope="module")
def slick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, sites.Site]:
    folder = tmp_path_factory.mktemp("slick")
    place = sites.site("slick")
    shots = sites.photographed(place)
    sites.write(shots, folder / "photos")
    sites.paint_classes(shots[3::10], folder / "painted")
    photos, eyes = str(folder / "photos"), str(folder / "eyes")
    quick = ("--model", "both", "--features", "color and texture")
    assert main(["tune", photos, "--examples", str(folder / "painted"), "--out", eyes, *quick]) == 0
    return folder, place


def map_region(folder: Path, results: Path) -> Path:
    out = results / "map"
    arguments = ["--detector", str(folder / "eyes"), "--refine", "off", "--no-ortho"]
    assert main(["replay", str(folder / "photos"), *arguments, "--out", str(out)]) in (0, 3)
    return out


def test_classes_painted_by_number_are_learned_and_mapped_with_area_and_litres(
    slick: tuple[Path, sites.Site], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, place = slick
    table = tomllib.loads((folder / "eyes" / "detector.toml").read_text("utf-8"))["detector"]
    assert table["classes"] == tomllib.loads(sites.CLASSES)
    report = json.loads((folder / "eyes" / "report.json").read_text("utf-8"))
    assert min(one["iou"] for one in report["classes"]) > 0.7
    out = map_region(folder, tmp_path)
    found = sites.classes_of_cells(out, place)
    summary = json.loads((out / "summary.json").read_text("utf-8"))
    assert [one["number"] for one in summary["classes"]] == [1, 2, 3, 4]
    for one in summary["classes"]:
        told, truth = (column == one["number"] for column in found.T)
        iou = np.count_nonzero(told & truth) / np.count_nonzero(told | truth)
        assert iou > MIN_IOU, (one["name"], iou)
        true_m2 = np.count_nonzero(place.numbers == one["number"]) * sites.GSD_M**2
        assert one["area_low_m2"] < true_m2 < one["area_high_m2"], (one, true_m2)
    for one, fine in zip(summary["classes"], summary["boundary_classes"], strict=True):
        true_m2 = np.count_nonzero(place.numbers == one["number"]) * sites.GSD_M**2
        assert fine["name"] == one["name"]
        assert fine["area_m2"] == pytest.approx(true_m2, rel=0.1)
    features = json.loads((out / "boundary.geojson").read_text("utf-8"))["features"]
    kinds = [one["properties"]["class"] for one in features if "class" in one["properties"]]
    assert kinds == [one["name"] for one in summary["classes"]]
    assert summary["volume_l"][1] is None
    assert "rainbow (class 2): " in capsys.readouterr().out


def test_region_of_some_classes_is_mapped_alone(
    slick: tuple[Path, sites.Site], tmp_path: Path
) -> None:
    folder, place = slick
    path = folder / "eyes" / "detector.toml"
    document = tomlkit.parse(path.read_text("utf-8"))
    document["detector"]["classes"]["region"] = ["metallic", "true_colour"]
    path.write_text(tomlkit.dumps(document))
    out = map_region(folder, tmp_path)
    summary = json.loads((out / "summary.json").read_text("utf-8"))
    assert [one["name"] for one in summary["classes"]] == ["metallic", "true_colour"]
    for one in summary["classes"]:
        true_m2 = np.count_nonzero(place.numbers == one["number"]) * sites.GSD_M**2
        assert one["area_low_m2"] < true_m2 < one["area_high_m2"], (one, true_m2)
    true_m2 = np.count_nonzero(place.numbers >= 3) * sites.GSD_M**2
    assert summary["area_low_m2"] < true_m2 < summary["area_high_m2"]
    told = sites.classes_of_cells(out, place)
    assert set(told[:, 0].tolist()) == {0, 3, 4}
