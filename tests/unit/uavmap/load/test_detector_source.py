"""Detectors as missions name them: tables of parameters, models from files, plug-ins.

A model is kept with its judgements. Files that uavmap writes beside photographs are no photographs.
"""

from __future__ import annotations

import shutil
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from PIL import Image

from missions.errors import ImageError, MissionFileError
from missions.mission.sections import DetectorSection
from tests.support.models import all_familiar
from tests.support.plans import plan_of
from tests.unit.missions.mission.test_mission_file import HEAD
from tests.unit.uavmap.photos.sources.test_replay_robust import good, mapped, shot
from tests.unit.uavmap.photos.test_replay import paint
from uavmap.journal.event_log import Journal, JournalReader
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.load import detector_source
from uavmap.load.detector_source import (
    KEPT,
    check_detector,
    detector_of_section,
    detector_text,
    keep_detector,
    known_detectors,
    region_in_words,
    resolved_section,
)
from uavmap.load.mission_source import load, mission_of_text
from uavmap.photos.sources.inventory import gather
from uavmap.photos.sources.photo_folder import Folder
from uavmap.photos.tune import tune_job as tuning
from uavmap.ui.cli import main
from vision.detectors.interface import certain
from vision.detectors.learned_model import Logistic, Model, model_bytes


def section(text: str) -> DetectorSection:
    return mission_of_text(f"{HEAD}\n{text}", "m.toml").detector


def fault(text: str) -> str:
    with pytest.raises(MissionFileError) as caught:
        section(text)
    return str(caught.value)


def test_detector_has_a_table_with_its_own_defaults():
    made = section('[detector]\nname = "paved"\n[detector.paved]\ngreenness = 0.1')
    assert str(detector_of_section(made)) == (
        "PavedDetector(greenness=0.1, intensity=90, dilations=1)"
    )


def test_mission_without_tables_keeps_its_detector():
    made = section('[detector]\nname = "paved"\ngreenness = 0.1')
    assert str(detector_of_section(made)) == (
        "PavedDetector(greenness=0.1, intensity=150, dilations=7)"
    )
    assert str(detector_of_section(section(""), 2.0)) == (
        "ThresholdDetector(intensity=150, dilations=4, polarity='dark')"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("detector.intensity = 255", "detector.intensity is 255: expected an integer from 0 to"),
        ('[detector]\nname = "paved"\n[detector.paved]\ngreeness = 0.1',
         "detector.greeness is not a parameter of the detector 'paved'"),
        ('[detector]\nname = "paved"\nintensity = 3\n[detector.paved]\ngreenness = 0.1',
         "intensity = 3 stands beside [detector.paved]; move it in there"),
        ("[detector.pavd]\ngreenness = 0.1", "detector.pavd: unknown detector; known: adap"),
        ('detector.name = "color"', "detector.samples is missing: the detector 'color' needs it"),
        ('detector.name = "learned"', "detector.model is missing"),
        ('[detector]\nname = "learned"\nmodel = "x"\n[detector.learned]\nmodel = 3',
         "detector.model is not a parameter"),
        ('detector.model = "x.json"', "the detector 'threshold' has no file; leave it out"),
        ('[detector]\nname = "index"\n[detector.index]\nkind = "evi"', "detector.kind is 'evi'"),
        ('[detector]\nname = "color"\n[detector.color]\nsamples = [[1, 2, 300]]',
         "detector.samples is [[1, 2, 300]]"),
        ('[detector]\nname = "adaptive"\n[detector.adaptive]\nwindow = 9', "detector.window is 9"),
    ],
)  # fmt: skip
def test_value_that_a_detector_refuses_fails_the_check(text, message):
    found = fault(text)
    assert found.startswith("m.toml: ")
    assert message in found


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("eyes.json", "detector.model = '{folder}/eyes.json': cannot be read"),
        (r"a\u0000b", r"detector.model = 'a\x00b': not the path of a file"),
    ],
)
def test_model_that_cannot_be_read_is_named(model, message, tmp_path, capsys):
    path = tmp_path / "field.toml"
    path.write_text(f'{HEAD}\n[detector]\nname = "learned"\nmodel = "{model}"\n')
    assert main(["check", str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{path}:8: {message.format(folder=tmp_path)}" in line


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "cannot be read"),
        ("detector = 3", "must hold the table [detector]"),
        ("[detector]\n[grid]", "must hold the table [detector] and nothing else"),
        ("[detector", "not a TOML file"),
        ('[detector]\nname = "learned"\nmodel = "a\\u0000b"', "not the path of a file"),
    ],
)
def test_folder_without_a_detector_is_refused(tmp_path, capsys, text, message):
    if text is not None:
        (tmp_path / "detector.toml").write_text(text)
    arguments = ["--detector", str(tmp_path), "--out", str(tmp_path / "out")]
    assert main(["fly", "runway", "--sim", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# --- plug-ins --------------------------------------------------------------------------------
class Everything:
    """A detector of a plug-in."""

    name: ClassVar[str] = "everything"
    calibrated: ClassVar[bool] = False

    def __init__(self, level: int = 3) -> None:
        self.level = level

    def mask(self, image: np.ndarray) -> np.ndarray:
        return np.full(image.shape[:2], 255, np.uint8)

    def probability(self, image: np.ndarray) -> np.ndarray:
        return certain(self.mask(image))


def nothing() -> object:
    return object()


@pytest.fixture
def plugins(monkeypatch):
    here = __name__
    points = [
        EntryPoint("everything", f"{here}:Everything", detector_source.GROUP),
        EntryPoint("nothing", f"{here}:nothing", detector_source.GROUP),
        EntryPoint("gone", "no_such_module:make", detector_source.GROUP),
        EntryPoint("paved", f"{here}:Everything", detector_source.GROUP),
    ]
    detector_source._plugins.cache_clear()
    monkeypatch.setattr(detector_source, "entry_points", lambda group: points)
    monkeypatch.setattr(EntryPoint, "load", _load)
    yield
    detector_source._plugins.cache_clear()


def _load(point: EntryPoint) -> object:
    if point.module == "no_such_module":
        raise ModuleNotFoundError("No module named 'no_such_module'")
    return {"Everything": Everything, "nothing": nothing}[point.attr]


@pytest.mark.usefixtures("plugins")
def test_plug_in_is_a_detector_like_any_other():
    assert "everything" in known_detectors()
    made = section('[detector]\nname = "everything"\n[detector.everything]\nlevel = 5')
    detector = detector_of_section(made)
    assert isinstance(detector, Everything)
    assert detector.level == 5
    assert "detector.depth is not a parameter" in fault(
        '[detector]\nname = "everything"\n[detector.everything]\ndepth = 5'
    )
    assert detector_of_section(DetectorSection(name="paved")).name == "paved"


@pytest.mark.usefixtures("plugins")
@pytest.mark.parametrize(
    ("name", "message"), [("nothing", "returns no detector"), ("gone", "cannot be loaded")]
)
def test_plug_in_that_does_not_work_is_named(name, message):
    with pytest.raises(MissionFileError, match=message):
        check_detector(DetectorSection(name=name))


# --- segmentation models ---------------------------------------------------------------------
MEAN = (Path(__file__).parents[3] / "data" / "mean.onnx").read_bytes()
"""A model for tiles of 32 pixels that returns the mean of the three channels."""


def onnx(folder: Path, toml: str, model: bytes = MEAN) -> DetectorSection:
    (folder / "net.toml").write_text(toml)
    (folder / "net.onnx").write_bytes(model)
    return DetectorSection(name="onnx", model=str(folder / "net.onnx"))


def test_segmentation_model_judges_tile_by_tile(tmp_path):
    pytest.importorskip("onnxruntime")
    toml = 'tile_px = 32\noutput = "probability"'
    detector = detector_of_section(onnx(tmp_path, toml))
    for shape in ((50, 70, 3), (20, 90, 3)):
        image = np.random.default_rng(1).integers(0, 256, shape, dtype=np.uint8)
        found = detector.probability(image)
        assert np.allclose(found, image.mean(axis=2) / 255.0, atol=1e-5)


@pytest.mark.parametrize(
    ("toml", "model", "message"),
    [
        ("tile_px = 32", b"no model", "not a model that onnxruntime can read"),
        ("tile_px = 32\ntile = 3", MEAN, "tile: unknown key"),
        ("tile_px = 32\nstd = [0.0, 1.0, 1.0]", MEAN, "std"),
        ("tile_px = ", MEAN, "not a TOML file"),
    ],
)
def test_faulty_segmentation_model_is_refused_with_a_reason(tmp_path, toml, model, message):
    pytest.importorskip("onnxruntime")
    with pytest.raises(MissionFileError, match=message):
        detector_of_section(onnx(tmp_path, toml, model))


def test_model_output_of_another_shape_is_an_image_error(tmp_path):
    pytest.importorskip("onnxruntime")
    detector = detector_of_section(onnx(tmp_path, "tile_px = 32\nchannel = 2"))
    with pytest.raises(ImageError, match="is the TOML file beside it right"):
        detector.mask(np.zeros((40, 40, 3), np.uint8))


TWO = "oil = {number = 2}\nweed = {number = 1}\n"


@pytest.mark.parametrize("beside", ["net.toml", "detector.toml"])
def test_classes_come_from_the_file_beside_the_model_and_the_region_from_the_mission(
    beside, tmp_path
):
    """The mission names the model; `--detector` names its folder."""
    name, model = ("onnx", "net.onnx") if beside == "net.toml" else ("learned", "model.json")
    (tmp_path / model).write_bytes(b"any")
    table, oil, weed = f'name = "{name}"\nmodel = "{model}"', {"number": 2}, {"number": 1}
    (tmp_path / "net.toml").write_text(f"tile_px = 32\n[classes]\n{TWO}")
    (tmp_path / "detector.toml").write_text(
        f"[detector]\n{table}\n" + ("" if name == "onnx" else f"[detector.classes]\n{TWO}")
    )
    given = {"name": name, "model": model}
    found = resolved_section(given, tmp_path, None)
    assert found is not None
    assert found["classes"] == {"oil": oil, "weed": weed}
    region = {"classes": {"region": ["oil"]}}
    found = resolved_section(given | region, tmp_path, None)
    assert DetectorSection.model_validate(found).explored == (2,)
    mission = {"name": "threshold", "share": 0.2, **region}
    found = resolved_section(mission, tmp_path, tmp_path)
    assert DetectorSection.model_validate(found).explored == (2,)
    assert found is not None
    assert found["share"] == 0.2


def test_description_of_the_region_names_the_explored_classes():
    colours = {"samples": {"oil": [[9, 9, 9]], "weed": [[9, 200, 9]]}}
    table = {"name": "color", "color": colours, "classes": {"oil": {"number": 1}}}
    table["classes"] |= {"weed": {"number": 2}, "region": ["oil"]}
    told = region_in_words(DetectorSection.model_validate(table))
    assert told == "oil: coloured like rgb(9, 9, 9), rgb(9, 200, 9)"


def test_sections_read_back_from_json_as_they_were():
    for more in ("", '[detector]\nname = "paved"\n[detector.paved]\ngreenness = 0.1'):
        given = section(more)
        kept = given.model_dump_json(exclude_unset=True)
        assert DetectorSection.model_validate_json(kept, strict=True) == given


__all__ = ["good"]  # a fixture


# --- kept with the results ------------------------------------------------------------------------
DARK = Logistic(bias=0.0, weights=(-4.0,), mean=(0.0,), scale=(1.0,))
MODEL = Model(features=("light",), parts=(DARK,), threshold=0.5, **all_familiar())


def eyes(folder: Path) -> Path:
    """Write a detector's folder as `uavmap tune` leaves it: dark is region."""
    folder.mkdir()
    (folder / "model.json").write_bytes(model_bytes(MODEL))
    (folder / "detector.toml").write_text(
        '[detector]\nname = "learned"\nmodel = "model.json"\nshare = 0.5\n'
    )
    return folder


def test_replay_stays_readable_without_its_detector(good, tmp_path):
    model = eyes(tmp_path / "eyes")
    line = ["replay", str(good), "--refine", "off"]
    one, two = tmp_path / "one", tmp_path / "two"
    assert main([*line, "--detector", str(model), "--out", str(one)]) == 0
    shutil.rmtree(model)
    moved = tmp_path / "elsewhere" / "one"
    shutil.move(one, moved)
    assert main([*line, "--mission", str(moved / "mission.toml"), "--out", str(two)]) == 0
    assert (two / "map.geojson").read_bytes() == (moved / "map.geojson").read_bytes()
    assert str((moved / KEPT).resolve()) in detector_text(moved / KEPT)  # also for --detector
    with Journal.open(moved / JOURNAL) as journal:
        section = FlightPlan.read(journal).mission.detector
    assert Path(section.model or "") == (moved / KEPT / "model.json").resolve()
    assert section.model_sha256 is not None


def test_flight_continues_without_the_original_file_of_its_model(tmp_path):
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
    # a copy that was changed is refused
    (folder / KEPT / "model.json").write_text("{}")
    assert FlightPlan.read(JournalReader(folder / JOURNAL)).mission.detector == section


def test_masks_overlays_and_results_below_the_photographs_are_left_out(good, tmp_path):
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
    assert mapped(photos, good, photos / "map")[0] == 0
    found = gather(Folder(photos))
    assert [p.name for p in found.pictures] == [p.name for p in alone]
    assert not found.refused
    assert "2 folders that uavmap has written" in found.left_out
    assert "4 drawn on pictures of the folder: masks, overlays" in found.left_out
    # a picture without tags keeps its name if no other has it
    Image.new("RGB", (100, 80)).save(photos / "other.png")
    assert "other.png" in [p.name for p in gather(Folder(photos)).pictures]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_interrupted_tuning_leaves_no_file(error, tmp_path, monkeypatch):
    shot(tmp_path / "0.jpg")

    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr(tuning, "load_examples", lambda *_: [])
    monkeypatch.setattr(tuning, "need_learner", lambda: None)
    monkeypatch.setattr(tuning, "learn", lambda *_: tuning.LearnedModel(MODEL, None, [], [], {}))
    monkeypatch.setattr(tuning, "_report", lambda *_: {"pixels": {}, "cells": {}})
    monkeypatch.setattr(tuning, "_detector_toml", lambda *_: "")
    monkeypatch.setattr(tuning, "_draw", fails)  # the last file that is written
    before = sorted(tmp_path.iterdir())
    line = ["tune", str(tmp_path), "--examples", str(tmp_path / "painted")]
    assert main([*line, "--out", str(tmp_path / "eyes")]) in (2, 130)
    assert sorted(tmp_path.iterdir()) == before
