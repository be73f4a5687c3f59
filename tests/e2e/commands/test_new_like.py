"""`uavmap new --like`: a mission whose detector is learned from painted photographs, in process."""

from __future__ import annotations

import re
import sys
import threading
import tomllib
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.unit.uavmap.ui.cli.commands.test_cli_new import Terminal
from uavmap.load.detector_source import detector_of_section
from uavmap.load.mission_source import load
from uavmap.photos.tune.tune_job import MODEL, OVERLAYS, TuneSettings
from uavmap.ui.cli import detector_choice, main
from vision.detectors.learned_model import LearnedDetector

NEW = ["new", "--at", "52.4568,13.3044", "--size", "40x30", "--drone", "sim", "--out", "field.toml"]


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    quick = TuneSettings(kinds=("logistic",), sets=("color",))
    monkeypatch.setattr(detector_choice, "TUNE_SETTINGS", quick)


def photograph(number: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(number)
    picture = np.full((120, 160, 3), (60, 140, 70), np.uint8)
    mask = np.zeros((120, 160), np.uint8)
    west, south = 20 + 25 * number, 20 + 10 * number
    picture[south : south + 50, west : west + 60] = (70, 80, 170)
    mask[south : south + 50, west : west + 60] = 255
    noise = rng.normal(0.0, 8.0, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8), mask


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    folder = tmp_path / "photos"
    folder.mkdir()
    for number in range(3):
        picture, mask = photograph(number)
        cv2.imwrite(str(folder / f"{number}.jpg"), picture)
        cv2.imwrite(str(folder / f"{number}.png"), mask)
    return folder


def assert_it_finds_the_field() -> None:
    mission = load("field.toml")
    detector = detector_of_section(mission.detector)
    assert isinstance(detector, LearnedDetector)
    picture, mask = photograph(1)
    found = detector.mask(picture) > 0
    assert np.count_nonzero(found & (mask > 0)) > 0.9 * np.count_nonzero(found | (mask > 0))


def test_new_like_masks_beside_photographs_learns_and_names_the_detector(photos, capsys):
    assert main([*NEW, "--like", *map(str, sorted(photos.glob("*.jpg")))]) == 0
    out, err = capsys.readouterr()
    assert "region = as learned by the model field-detector/model.json" in out
    assert "uavmap fly field.toml --sim --detector threshold" in out
    assert "check field-detector/overlays before you use it" in err
    assert "check what it marks: field-detector/overlays (red: marked, green: painted)" in out
    section = tomllib.loads(Path("field.toml").read_text("utf-8"))["detector"]
    assert section["model"] == "field-detector/model.json"
    assert (Path("field-detector") / MODEL).is_file()
    assert len(list((Path("field-detector") / OVERLAYS).iterdir())) == 3
    assert main(["check", "field.toml"]) == 0
    folder = (Path("field-detector") / OVERLAYS).resolve()
    assert f"check what it marks: {folder} (red" in capsys.readouterr().out
    assert_it_finds_the_field()


def test_new_like_folder_with_masks_in_it_uses_them_as_masks(photos):
    assert main([*NEW, "--like", str(photos)]) == 0
    assert_it_finds_the_field()


def test_new_like_without_masks_opens_the_page_to_paint_on(photos, monkeypatch, capfd):
    for mask in photos.glob("*.png"):
        mask.unlink()
    monkeypatch.setattr(sys, "stdin", Terminal(""))
    painter = threading.Thread(target=paints, args=(capfd,))
    painter.start()
    try:
        assert main([*NEW, "--like", str(photos)]) == 0
    finally:
        painter.join()
    assert sorted(path.name for path in Path("field-painted").iterdir()) == [
        "0.png", "1.png", "2.png",
    ]  # fmt: skip
    assert_it_finds_the_field()


def paints(capfd: pytest.CaptureFixture[str]) -> None:
    told = ""
    while not (found := re.search(r"http://127\.0\.0\.1:\d+/[\w-]+/", told)):
        told += capfd.readouterr().err
    for number in range(3):
        data = cv2.imencode(".png", photograph(number)[1])[1].tobytes()
        sent(f"{found.group()}mask/{number}", data, "PUT")
    sent(f"{found.group()}done", b"", "POST")


def sent(address: str, data: bytes, method: str) -> None:
    with urllib.request.urlopen(urllib.request.Request(address, data, method=method)) as answer:
        assert answer.status == 200


def test_new_like_without_masks_and_terminal_explains_how_to_paint(photos, capsys):
    for mask in photos.glob("*.png"):
        mask.unlink()
    assert main([*NEW, "--like", str(photos)]) == 2
    assert (
        "no mask beside it; paint 0.png (white: region, black: not region)"
        in capsys.readouterr().err
    )
    assert not Path("field.toml").exists()
    assert not Path("field-detector").exists()
