"""What uavmap writes beside photographs is no photograph; a model is kept with what it judged."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from PIL import Image

from tests.support.plans import plan_of
from tests.unit.uavmap.photos.sources.test_replay_robust import good, mapped, shot
from tests.unit.uavmap.photos.test_replay import paint
from uavmap.journal.event_log import Journal, JournalReader
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.load.detector_source import KEPT, detector_text, keep_detector
from uavmap.load.mission_source import load
from uavmap.photos.sources.inventory import gather
from uavmap.photos.sources.photo_folder import Folder
from uavmap.photos.tune import tune_job as tuning
from uavmap.ui.cli import main
from vision.detectors.learned_model import Logistic, Model, model_bytes

__all__ = ["good"]  # a fixture


DARK = Logistic(bias=0.0, weights=(-4.0,), mean=(0.0,), scale=(1.0,))
MODEL = Model(features=("light",), parts=(DARK,), threshold=0.5)


def eyes(folder: Path) -> Path:
    """A detector's folder as `uavmap tune` leaves it: dark is region."""
    folder.mkdir()
    (folder / "model.json").write_bytes(model_bytes(MODEL))
    (folder / "detector.toml").write_text(
        '[detector]\nname = "learned"\nmodel = "model.json"\nshare = 0.5\n'
    )
    return folder


def test_a_replay_outlives_the_detector_that_it_was_made_with(good: Path, tmp_path: Path) -> None:
    model = eyes(tmp_path / "eyes")
    line = ["replay", str(good), "--refine", "off"]
    one, two = tmp_path / "one", tmp_path / "two"
    assert main([*line, "--detector", str(model), "--out", str(one)]) == 0
    shutil.rmtree(model)
    moved = tmp_path / "elsewhere" / "one"
    shutil.move(one, moved)
    assert main([*line, "--mission", str(moved / "mission.toml"), "--out", str(two)]) == 0
    assert (two / "map.geojson").read_bytes() == (moved / "map.geojson").read_bytes()
    assert str((moved / KEPT).resolve()) in detector_text(moved / KEPT)  # for --detector, too
    with Journal.open(moved / JOURNAL) as journal:
        section = FlightPlan.read(journal).mission.detector
    assert Path(section.model or "") == (moved / KEPT / "model.json").resolve()
    assert section.model_sha256 is not None


def test_a_flight_goes_on_without_the_file_that_its_model_came_from(tmp_path: Path) -> None:
    model = eyes(tmp_path / "eyes")
    mission = load("runway", str(model))
    section = mission.detector
    folder = tmp_path / "flight"
    keep_detector(section, folder)
    shutil.rmtree(model)
    plan = plan_of("runway", mission, None, None, 0, (), None, 0.0)
    with Journal.create(folder / JOURNAL, {"plan": plan.as_json()}) as journal:
        read = FlightPlan.read(journal).mission
    assert read.detector.model == str((folder / KEPT / "model.json").resolve())
    # a copy that somebody has changed is none
    (folder / KEPT / "model.json").write_text("{}")
    assert FlightPlan.read(JournalReader(folder / JOURNAL)).mission.detector == section


def test_masks_overlays_and_results_below_the_photographs_are_left_out(
    good: Path, tmp_path: Path
) -> None:
    photos = tmp_path / "photos"
    shutil.copytree(good, photos)
    alone = gather(Folder(photos)).pictures
    drawn = paint(10.0, 10.0, 0.0)
    (photos / "painted").mkdir()
    drawn.convert("1").save(photos / "painted" / "0.png")
    drawn.save(photos / "1-looked.png")
    for number, name in enumerate(("0.jpg.png", "1_mask.png")):
        paint(10.0, 12.0 + number, 0.0).save(photos / "painted" / name)
    eyes(photos / "my-field")
    (photos / "my-field" / "overlays").mkdir()
    drawn.save(photos / "my-field" / "overlays" / "0.jpg")
    assert mapped(photos, good, photos / "map", "--refine", "off")[0] == 0
    found = gather(Folder(photos))
    assert [p.name for p in found.pictures] == [p.name for p in alone]
    assert not found.refused
    assert "2 folders that uavmap has written" in found.left_out
    assert "4 drawn on pictures of the folder: masks, overlays" in found.left_out
    # a picture without tags that is named after no other is named as before
    Image.new("RGB", (100, 80)).save(photos / "other.png")
    assert "other.png" in [p.name for p in gather(Folder(photos)).pictures]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_an_interrupted_tuning_leaves_nothing(
    error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shot(tmp_path / "0.jpg")

    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr(tuning, "load_examples", lambda *_: [])
    monkeypatch.setattr(tuning, "need_learner", lambda: None)
    monkeypatch.setattr(tuning, "learned", lambda *_: (MODEL, None, []))
    monkeypatch.setattr(tuning, "_report", lambda *_: {"pixels": {}, "cells": {}})
    monkeypatch.setattr(tuning, "_detector_toml", lambda *_: "")
    monkeypatch.setattr(tuning, "_draw", fails)  # the last that is written
    before = sorted(tmp_path.iterdir())
    line = ["tune", str(tmp_path), "--examples", str(tmp_path / "painted")]
    assert main([*line, "--out", str(tmp_path / "eyes")]) in (2, 130)
    assert sorted(tmp_path.iterdir()) == before
