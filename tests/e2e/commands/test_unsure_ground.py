"""Ground that no example shows: unsure on the map, and its picture is requested."""

from __future__ import annotations

import json
from pathlib import Path
from urllib.request import Request, urlopen

import cv2
import numpy as np
import pytest

from tests.support.ground import sites
from uavmap.photos.tune.paint_page import Easel, served
from uavmap.photos.tune.selection import Counts
from uavmap.photos.tune.study import Study
from uavmap.photos.tune.tune_job import TuneSettings
from uavmap.ui.cli import main


@pytest.fixture(scope="module")
def mapped(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, sites.Site, list[sites.Shot]]:
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
    return folder, place, shots


def test_ground_like_no_example_is_unsure_and_sure_ground_is_right(mapped):
    folder, place, _ = mapped
    region, unsure, truth = sites.judged_cells(folder / "map", place)
    assert 0.6 < 1 - unsure.mean() < 0.85  # bare and ploughed soil, roofs, panels are not
    assert Counts.compare(region, truth, ~unsure).iou > 0.85


def test_picture_that_settles_most_is_asked_for_and_the_summary_counts(mapped):
    folder, place, shots = mapped
    summary = json.loads((folder / "map" / "summary.json").read_text("utf-8"))
    unsure = int(sites.judged_cells(folder / "map", place)[1].sum())
    assert 0.9 < unsure / summary["cells_unsure"] <= 1  # a map reaches over the rim of the site
    assert (summary["completed"], summary["flown_to_the_end"]) == (False, True)
    assert f"{summary['cells_unsure']} cells" in summary["finding"]
    lines = (folder / "map" / "next.txt").read_text("utf-8").splitlines()
    areas_m2 = [float(line.split("\t")[1]) for line in lines]
    assert areas_m2 == sorted(areas_m2, reverse=True)
    assert 0.4 * summary["cells_unsure_m2"] < areas_m2[0] <= summary["cells_unsure_m2"] + 1
    first = next(shot for shot in shots if lines[0].startswith(shot.name))
    assert first.east_m > sites.WIDTH_M / 2  # what looks like the track lies in the east
    assert (folder / "eyes" / "next.txt").read_text("utf-8").startswith(lines[0].split("\t")[0])


def test_page_learns_and_outlines_unfamiliar_ground_on_the_map(mapped, tmp_path):
    folder, *_ = mapped
    photos, painted = folder / "photos", folder / "painted"
    study = Study(photos, painted, tmp_path / "eyes", TuneSettings())
    easel = Easel(photos, painted, 1000, study)
    with served(easel) as address:
        before = json.loads(ask(address, "round"))
        assert (before["number"], before["asked"]) == (0, [])
        assert ask(address, "learn", method="POST") == b"learning"
        study.finish()
        after = json.loads(ask(address, "round"))
        assert (after["busy"], after["number"]) == (False, 1)
        assert ask(address, "map").startswith(b"\x89PNG")
        picture, _ = after["asked"][0]
        index = [path.stem for path in easel.pictures].index(picture)
        outlines = cv2.imdecode(
            np.frombuffer(ask(address, f"doubtful/{index}"), np.uint8), cv2.IMREAD_UNCHANGED
        )
    assert outlines.shape[2] == 4
    assert (outlines[:, :, 3] > 0).sum() > 500


def ask(address: str, what: str, method: str = "GET") -> bytes:
    with urlopen(Request(address + what, method=method)) as answer:
        found: bytes = answer.read()
    return found
