"""Ground that no example shows: unsure on the map, and the picture of it is asked for."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support import sites
from uavmap.photos.tune.selection import Counts
from uavmap.ui.cli import main


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, sites.Site]:
    """A folder with photographs of a gravel track, a detector of three of them, and its map."""
    folder = tmp_path_factory.mktemp("track")
    place = sites.site("track")
    shots = sites.photographed(place)
    sites.write(shots, folder / "photos")
    sites.paint(sites.western(shots), folder / "painted")
    photos, eyes = str(folder / "photos"), str(folder / "eyes")
    quick = ("--model", "both", "--features", "color and texture")
    assert main(["tune", photos, "--examples", str(folder / "painted"), "--out", eyes, *quick]) == 0
    arguments = ("--refine", "off", "--no-ortho", "--out", str(folder / "map"))
    assert main(["replay", photos, "--detector", eyes, *arguments]) == 3
    return folder, place


def test_ground_like_no_example_is_unsure_and_what_is_sure_is_right(
    mapped: tuple[Path, sites.Site],
) -> None:
    folder, place = mapped
    region, unsure, truth = sites.judged_cells(folder / "map", place)
    assert 0.6 < 1 - unsure.mean() < 0.85  # bare and ploughed soil, roofs, panels are not
    assert Counts.of(region, truth, ~unsure).iou > 0.85


def test_the_picture_is_asked_for_that_settles_most_and_the_summary_counts(
    mapped: tuple[Path, sites.Site],
) -> None:
    folder, place = mapped
    summary = json.loads((folder / "map" / "summary.json").read_text("utf-8"))
    unsure = int(sites.judged_cells(folder / "map", place)[1].sum())
    assert 0 <= summary["cells_unsure"] - unsure < 200  # those at the rim reach over the site
    assert summary["completed"] is False
    assert f"{summary['cells_unsure']} cells" in summary["finding"]
    lines = (folder / "map" / "next.txt").read_text("utf-8").splitlines()
    areas_m2 = [float(line.split("\t")[1]) for line in lines]
    assert areas_m2 == sorted(areas_m2, reverse=True)
    assert 0.4 * summary["cells_unsure_m2"] < areas_m2[0] <= summary["cells_unsure_m2"] + 1
    first = next(shot for shot in sites.photographed(place) if lines[0].startswith(shot.name))
    assert first.east_m > sites.WIDTH_M / 2  # what looks like the track lies in the east
    assert (folder / "eyes" / "next.txt").read_text("utf-8").startswith(lines[0].split("\t")[0])
