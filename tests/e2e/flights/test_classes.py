"""A slick of five appearances, flown over in the simulator: areas and litres by class."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from missions.mission.schema import positions
from tests.e2e.rig import uavmap
from tests.support.plans import named_text
from uavmap.output.results import flown_of

MIN_IOU = 0.6


def slick_with_fewer_pictures(folder: Path) -> Path:
    """Return the file of the shipped mission with every second picture left out."""
    path = folder / "slick.toml"
    path.write_text(named_text("slick").text.replace("interval_s = 0.2", "interval_s = 0.4"))
    return path


def truths(folder: Path) -> list[BaseGeometry]:
    """Return the visible area of each simulated film, the thinnest first: the next covers it."""
    setting = flown_of(folder).setting
    films = [
        Polygon([setting.grid.fixed(place) for place in positions(region.polygon)])
        for region in setting.mission.sim.roi
    ]
    return [one.difference(over) for one, over in itertools.pairwise([*films, Polygon()])]


def test_slick_flown_areas_and_litres_of_each_appearance_hold_the_true_ones(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "slick"
    source = slick_with_fewer_pictures(tmp_path)
    done = uavmap("fly", source, "--sim", "--json", "--out", folder)
    assert done.code == 0, done.err
    summary, found = done.summary, flown_of(folder).data.class_areas
    names = ["sheen", "rainbow", "metallic", "discontinuous", "continuous"]
    assert [one["name"] for one in summary["classes"]] == names
    least_l = 0.0
    for told, area, truth in zip(summary["classes"], found, truths(folder), strict=True):
        assert told == area.figures()
        assert told["area_low_m2"] < truth.area < told["area_high_m2"], told
        overlap = area.outline.intersection(truth).area / area.outline.union(truth).area
        assert overlap > MIN_IOU, (told["name"], overlap)
        low_l, high_l = told["volume_l"]
        least, *most = (um * truth.area / 1000.0 for um in area.thickness_um or ())
        assert low_l < least
        assert (high_l is None) == (not most)
        assert not most or most[0] < high_l
        least_l += least
    assert summary["volume_l"][0] < least_l
    assert summary["volume_l"][1] is None
    features = json.loads((folder / "map.geojson").read_text())["features"]
    kinds = [one["properties"] for one in features if one["properties"]["kind"] == "class"]
    assert [one["area_m2"] for one in kinds] == [one["area_m2"] for one in summary["classes"]]
    cells = [one["properties"]["class"] for one in features if "class" in one["properties"]]
    assert [cells.count(name) for name in names] == [one["cells"] for one in summary["classes"]]
    report = (folder / "report.html").read_text()
    assert all(f'<td data-head="Name">{name}</td>' in report for name in names)
    assert "litres or more" in report


def test_slick_flown_by_a_fleet_has_in_each_map_the_classes_of_all(tmp_path: Path) -> None:
    """Each of two services maps a part, and receives the other's part."""
    out, source = tmp_path / "fleet", slick_with_fewer_pictures(tmp_path)
    done = uavmap(
        "fly", source, "--sim", "--vehicles", 2, "--comms", "free", "--json", "--out", out
    )
    assert done.code == 0, done.err
    whole = flown_of(out)
    for area, truth in zip(whole.data.class_areas, truths(out), strict=True):
        overlap = area.outline.intersection(truth).area / area.outline.union(truth).area
        assert overlap > MIN_IOU, (area.name, overlap)
    minutes = (done.summary["makespan_s"] + 20.0) / 60.0
    for number, sent in done.summary["bytes_on_air"].items():
        assert sent < 5_000 * minutes
        of_all, own = whole.data, flown_of(out / f"vehicle-{number}").data
        assert own.roi_cells == of_all.roi_cells
        classes = [dict(zip(map(tuple, data.cells.cells.tolist()), data.cells.classes.tolist(),
                            strict=True)) for data in (own, of_all)]  # fmt: skip
        alike = [classes[0][cell] == classes[1][cell] for cell in own.roi_cells]
        assert sum(alike) > 0.9 * len(alike)
        for area, truth in zip(own.class_areas, truths(out), strict=True):
            assert area.low_m2 < truth.area < area.high_m2, area.name
