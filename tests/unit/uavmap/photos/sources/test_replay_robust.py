"""A folder with three good pictures and a bad one: the good ones are mapped, the bad one named."""

from __future__ import annotations

import csv
import json
import os
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.benchmarks.photos.replay import mutations, peak_mb, survives
from tests.support.photographs import dji
from tests.unit.uavmap.base.test_pictures import png
from tests.unit.uavmap.photos.test_replay import HEIGHT, WIDTH, field_text, geotag, paint, shot
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL
from uavmap.load.mission_source import mission_of_text
from uavmap.output.facts.flown_mission import BOUNDARY_FILE as BOUNDARY
from uavmap.photos import scratch_file
from uavmap.photos.mission_from_photos import derived
from uavmap.photos.sources.inventory import gather
from uavmap.photos.sources.photo_folder import Folder
from uavmap.ui.cli import main
from vision.camera import Lens

PLACES = ((10.0, 10.0), (16.0, 14.0), (14.0, 16.0))


def xmp(**changes: str) -> bytes:
    return dji(**{"RelativeAltitude": "+40.00", "GimbalYawDegree": "+0.00", **changes})


def flat(level: int) -> Image.Image:
    noise = np.random.default_rng(level).normal(level, 3.0, (HEIGHT, WIDTH, 3))
    return Image.fromarray(np.clip(noise, 0, 255).astype(np.uint8))


def truncated(path: Path) -> None:
    shot(path, 9)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])


def blurred(path: Path) -> None:
    soft = cv2.GaussianBlur(np.asarray(paint(14.0, 12.0, 0.0, seed=9)), (0, 0), 6.0)
    shot(path, 9, image=Image.fromarray(soft))


def jpeg_bomb(path: Path) -> None:
    """Write a small picture whose frame header states 60,000 x 60,000 pixels."""
    shot(path, 9)
    data = bytearray(path.read_bytes())
    at = 2
    while data[at + 1] not in (0xC0, 0xC2):  # from segment to segment, to the frame
        at += 2 + int.from_bytes(data[at + 2 : at + 4])
    data[at + 5 : at + 9] = (60_000).to_bytes(2) * 2
    path.write_bytes(bytes(data))


def tiff_bomb(path: Path) -> None:
    """Write a directory that states as many, and no pixels."""
    tags = ((256, 60_000), (257, 60_000), (258, 8), (259, 1), (262, 1), (273, 8), (279, 1))
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    head = b"II*\0" + struct.pack("<IH", 8, len(tags))
    path.write_bytes(head + entries + bytes(40))


def video(path: Path) -> None:
    path.write_bytes(b"\0\0\0\x18ftypmp42\0\0\0\0mp42isom" + bytes(4000))


NULL_ISLAND = {1: "N", 2: (0.0, 0.0, 0.0), 3: "E", 4: (0.0, 0.0, 0.0)}
AFAR = {1: "S", 2: (33.0, 0.0, 0.0), 3: "E", 4: (151.0, 0.0, 0.0)}

BAD: dict[str, tuple[Callable[[Path], object], str]] = {
    "empty": (lambda p: p.write_bytes(b""), "empty"),
    "torn head": (lambda p: p.write_bytes(b"\xff\xd8\xff\xe1\x00\x20Exif"), "not a"),
    "truncated": (truncated, "truncated"),
    "a video": (video, "not a readable picture (no JPEG, PNG or TIFF)"),
    "a PNG by the name of jpg": (
        lambda p: Image.fromarray(np.zeros((40, 60), np.uint8)).save(p, "PNG"),
        "no geotag",
    ),
    "no tags": (lambda p: paint(14.0, 12.0, 0.0).save(p, "JPEG"), "no geotag"),
    "turned": (lambda p: shot(p, 9, orientation=6), "Orientation is 6"),
    "below the ground": (
        lambda p: shot(p, 9, xmp=xmp(RelativeAltitude="-12.3")),
        "its height is -12.3 m",
    ),
    "at the horizon": (
        lambda p: shot(p, 9, xmp=xmp(GimbalPitchDegree="0")),
        "0 deg below the horizon",
    ),
    "400 m up": (lambda p: shot(p, 9, xmp=xmp(RelativeAltitude="+400")), "the others about 40 m"),
    "another continent": (lambda p: shot(p, 9, gps=AFAR), "km from the mission's start"),
    "no fix": (lambda p: shot(p, 9, gps=NULL_ISLAND), "geotag is 0, 0"),
    "another day": (lambda p: shot(p, 9, taken="2019:01:01 10:00:00"), "days before the others"),
    "a pixel": (lambda p: shot(p, 9, image=Image.new("RGB", (1, 1))), "too few"),
    "dark": (lambda p: shot(p, 9, image=flat(2)), "dark"),
    "bright": (lambda p: shot(p, 9, image=flat(254)), "exposed"),
    "blurred": (blurred, "blurred"),
    "a bomb": (lambda p: p.write_bytes(png(60_000, 60_000)), "too many"),
    "a JPEG bomb": (jpeg_bomb, "too many pixels"),
    "a TIFF bomb": (tiff_bomb, "too many pixels"),
    "uniform": (
        lambda p: shot(p, 9, image=Image.new("RGB", (WIDTH, HEIGHT), (90, 120, 80))),
        "uniform",
    ),
    "near the horizon": (
        lambda p: shot(p, 9, xmp=xmp(GimbalPitchDegree="-20")),
        "20 deg below the horizon",
    ),
    "20 km off": (lambda p: shot(p, 9, gps=geotag(20_000.0, 12.0)), "20 km from"),
    "no date and no heading": (
        lambda p: shot(
            p,
            9,
            taken=None,
            xmp=dji(RelativeAltitude="+40", GimbalYawDegree=None, FlightYawDegree=None),
        ),
        "no heading",
    ),
}

GOOD: dict[str, Callable[[Path], object]] = {
    "gray": lambda p: shot(p, 9, image=paint(14.0, 12.0, 0.0, seed=9).convert("L")),
    "CMYK": lambda p: shot(p, 9, image=paint(14.0, 12.0, 0.0, seed=9).convert("CMYK")),
    "large": lambda p: shot(p, 9, image=paint(14.0, 12.0, 0.0, seed=9).resize((3000, 2250))),
    "without a date": lambda p: shot(p, 9, taken=None),
}


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make the good pictures and the mission."""
    folder = tmp_path_factory.mktemp("good")
    for seed, place in enumerate(PLACES):
        shot(folder / f"{seed}.jpg", seed, place)
    (folder / "m.toml").write_text(field_text(), "utf-8")
    return folder


def mapped(
    photos: Path, good: Path, out: Path, refine: str = "off"
) -> tuple[int, dict[str, dict[str, str]], dict[str, object]]:
    """Return the exit code, the rows of pictures.csv by name, and the summary."""
    line = ["replay", str(photos), "--mission", str(good / "m.toml"), "--out", str(out)]
    code = main([*line, "--refine", refine, "--no-ortho"])
    with (out / "pictures.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["picture"]: row for row in csv.DictReader(file)}
    return code, rows, json.loads((out / "summary.json").read_text("utf-8"))


def folder_of(good: Path, tmp_path: Path) -> Path:
    photos = tmp_path / "photos"
    photos.mkdir()
    for path in good.glob("*.jpg"):
        shutil.copy(path, photos)
    return photos


@pytest.fixture(scope="module")
def alone(good: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the map of the good pictures alone."""
    tmp_path = tmp_path_factory.mktemp("alone")
    code, _, _ = mapped(folder_of(good, tmp_path), good, tmp_path / "out")
    assert code == 0
    return (tmp_path / "out" / "map.geojson").read_bytes()


@pytest.mark.parametrize("case", BAD)
def test_bad_picture_is_named_and_the_others_make_their_map(
    case: str, good: Path, alone: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make, reason = BAD[case]
    photos = folder_of(good, tmp_path)
    make(photos / "bad.jpg")
    code, rows, summary = mapped(photos, good, tmp_path / "out")
    assert code == 0
    assert reason in rows["bad.jpg"]["reason"]
    assert [rows[f"{n}.jpg"]["used"] for n in range(3)] == ["yes"] * 3
    assert (summary["photographs_judged"], summary["photographs_refused"]) == (3, 1)
    assert (tmp_path / "out" / "map.geojson").read_bytes() == alone
    output = capsys.readouterr().err
    assert [line for line in output.splitlines() if line.startswith("bad.jpg: ")]


@pytest.mark.parametrize("case", GOOD)
def test_picture_of_an_unusual_kind_is_mapped(case: str, good: Path, tmp_path: Path) -> None:
    photos = folder_of(good, tmp_path)
    GOOD[case](photos / "more.jpg")
    code, rows, _ = mapped(photos, good, tmp_path / "out")
    assert code == 0
    assert [row["used"] for row in rows.values()] == ["yes"] * 4, rows


def test_files_that_are_no_pictures_are_reported_by_kind(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photos = folder_of(good, tmp_path)
    (photos / "._0.jpg").write_bytes(b"Mac OS X")
    (photos / "gone.jpg").symlink_to(tmp_path / "nowhere.jpg")
    video(photos / "DJI_1.MP4")
    for name in ("a.txt", "b.txt", "README"):
        (photos / name).write_text("no picture")
    code, rows, _ = mapped(photos, good, tmp_path / "out")
    assert code == 0
    assert sorted(rows) == ["0.jpg", "1.jpg", "2.jpg"]
    told = [line.partition("not read: ")[2] for line in capsys.readouterr().err.splitlines()]
    assert {line.split(";")[0] for line in told if line} == {
        "2 of another kind: .txt",
        "1 of another kind: no ending",
        "1 beginning with ._ (notes of a Mac, no pictures)",
        "1 links that lead nowhere",
        "1 videos",
    }


def test_name_in_two_folders_is_two_pictures(good: Path, tmp_path: Path) -> None:
    photos = folder_of(good, tmp_path)
    (photos / "deep" / "er").mkdir(parents=True)
    shot(photos / "deep" / "er" / "0.jpg", 30)
    _, rows, summary = mapped(photos, good, tmp_path / "out")
    assert rows["deep/er/0.jpg"]["used"] == rows["0.jpg"]["used"] == "yes"
    assert summary["photographs_judged"] == 4


def test_map_of_mostly_bad_pictures_is_not_complete(good: Path, tmp_path: Path) -> None:
    """Poses are refined: pictures that cannot be decoded end neither that nor the map."""
    photos = folder_of(good, tmp_path)
    cases = ("empty", "torn head", "truncated", "turned", "a pixel", "a bomb")
    for case in cases:
        BAD[case][0](photos / f"{case}.jpg")
    mapped(good, good, tmp_path / "alone", "on")
    code, rows, summary = mapped(photos, good, tmp_path / "out", "on")
    assert code == 3
    alone, found = (tmp_path / name / "map.geojson" for name in ("alone", "out"))
    assert found.read_bytes() == alone.read_bytes()
    assert {rows[f"{case}.jpg"]["used"] for case in cases} == {"no"}
    assert summary["completed"] is False
    assert summary["cells_roi"]


def test_replay_of_bad_pictures_alone_is_refused_with_the_reason(
    tmp_path: Path, good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shot(tmp_path / "a.jpg", gps={})
    out = tmp_path / "out"
    for arguments in ((), ("--mission", str(good / "m.toml"))):
        assert main(["replay", str(tmp_path), *arguments, "--out", str(out)]) == 2
        (line,) = [x for x in capsys.readouterr().err.splitlines() if x.startswith("uavmap: ")]
        assert "a.jpg: no geotag" in line
        assert not out.exists()


def test_replay_without_a_mission_derives_one_that_can_be_given_again(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photos = folder_of(good, tmp_path)
    out, again = tmp_path / "out", tmp_path / "again"
    assert main(["replay", str(photos), "--out", str(out)]) == 0
    text = (out / "mission.toml").read_text("utf-8")
    assert "cell_m = 2" in text  # 25 pixels of 8 cm
    assert "cells of 2 m" in capsys.readouterr().err
    file = out / "mission.toml"
    assert main(["replay", str(photos), "--mission", str(file), "--out", str(again)]) == 0
    assert (out / "map.geojson").read_bytes() == (again / "map.geojson").read_bytes()


def test_pictures_far_from_the_start_are_judged(good: Path, tmp_path: Path) -> None:
    """A kilometre away, from 40 m: the start of the grid does not matter to the pictures."""
    photos = tmp_path / "photos"
    photos.mkdir()
    for seed in range(3):
        shot(photos / f"{seed}.jpg", seed, (1000.0 + 4 * seed, 12.0))
    code, rows, summary = mapped(photos, good, tmp_path / "out")
    assert code == 0
    assert [int(row["cells"]) > 100 for row in rows.values()] == [True] * 3
    assert summary["photographs_judged"] == 3


def test_angle_of_view_states_its_source(good: Path, tmp_path: Path) -> None:
    text = derived(gather(Folder(good)))
    assert "from EXIF FocalLengthIn35mmFilm of 3 of 3 pictures" in text
    lens = Lens.pinhole(1.2, WIDTH, HEIGHT)
    assert "# from the calibration" in derived(gather(Folder(good)), lens)
    shot(tmp_path / "0.jpg", film_mm=None)
    assert "a guess" in derived(gather(Folder(tmp_path)))


def test_number_of_workers_does_not_change_the_files(good: Path, tmp_path: Path) -> None:
    photos = folder_of(good, tmp_path)
    (photos / "bad.jpg").write_bytes(b"")
    made = []
    for workers in ("1", "3"):
        out = tmp_path / workers
        arguments = ["--mission", str(good / "m.toml"), "--out", str(out), "--workers", workers]
        assert main(["replay", str(photos), *arguments]) == 0
        names = ("map.geojson", "map.kml", "map.png", "summary.json", "pictures.csv", BOUNDARY)
        with Journal.open(out / JOURNAL) as journal:
            made.append([journal.bodies(), *((out / name).read_bytes() for name in names)])
    assert made[0] == made[1]


def test_impossible_output_is_refused_before_pictures_are_read(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "map"):
        assert main(["replay", str(tmp_path / "none"), "--out", str(out)]) == 2
        assert f"--out {out}" in capsys.readouterr().err


@pytest.mark.parametrize(("refine", "remedy"), [("off", "TMPDIR"), ("on", "--refine off")])
def test_full_disk_is_reported_in_a_line(
    refine: str,
    remedy: str,
    good: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    full, out = Path("/dev/full"), tmp_path / "map"
    if not full.exists():
        pytest.skip("no /dev/full")
    line = ["replay", str(good), "--mission", str(good / "m.toml"), "--out", str(out)]
    with monkeypatch.context() as patch:
        patch.setattr(scratch_file.tempfile, "TemporaryFile", lambda **_: full.open("w+b", 0))
        assert main([*line, "--refine", refine]) == 2
    err = capsys.readouterr().err
    assert "No space left" in err
    assert remedy in err
    assert not out.exists()


def test_folder_in_place_of_a_result_is_reported_in_a_line(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out" / "map.png").mkdir(parents=True)
    line = ["replay", str(good), "--mission", str(good / "m.toml"), "--refine", "off"]
    assert main([*line, "--out", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert "the results cannot be written (map.png: Is a directory); mend that" in err


def test_name_that_is_no_text_ends_nothing(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photos = tmp_path / "photos"
    shutil.copytree(good, photos)
    name = os.fsdecode(b"[red]\xff\n.jpg")
    try:
        (photos / "0.jpg").rename(photos / name)
    except OSError:
        pytest.skip("this file system knows no such names")
    out = tmp_path / "map"
    line = [str(photos), "--mission", str(good / "m.toml"), "--out", str(out)]
    assert main(["replay", *line]) in (0, 3)
    told = json.loads((out / "registration.json").read_text("utf-8"))
    assert name in [entry["name"] for entry in told["pictures"]]
    seen = ["--mission", str(good / "m.toml"), "--out", str(tmp_path / "seen.png")]
    capsys.readouterr()
    assert main(["look", str(photos / name), *seen]) == 0
    assert "\\udcff" in capsys.readouterr().out


def test_derived_mission_needs_two_of_three_votes_where_pictures_overlap(tmp_path: Path) -> None:
    """With two votes both would have to agree, however many pictures show the place."""
    shot(tmp_path / "0.jpg", 0, PLACES[0])
    found = []
    for place in (PLACES[1], (400.0, 10.0)):
        shot(tmp_path / "1.jpg", 1, place)
        votes = mission_of_text(derived(gather(Folder(tmp_path))), "derived").votes
        found.append((votes.frames, votes.positive))
    assert found == [(3, 2), (1, 1)]


def test_damaged_picture_is_refused_or_used(tmp_path: Path) -> None:
    data = shot(tmp_path / "a.jpg", 1).read_bytes()
    before = peak_mb()
    outcomes = {survives(bad, tmp_path / "bad.jpg") for bad in mutations(data, 60)}
    assert {"pixels", "used"} <= outcomes
    assert peak_mb() - before < 100.0
