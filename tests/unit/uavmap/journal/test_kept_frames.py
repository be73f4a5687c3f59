"""Pictures that a flight keeps, on a disk that is full."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import NamedTuple

import pytest

from missions.units import LatLon, Pose, Quaternion
from uavmap.journal.kept_frames import FRAMES, POSES, ROOM_MIB, FrameKeeper, KeptFrame, read_kept

PICTURE = b"\xff\xd8" + bytes(5000)
FULL = Path("/dev/full")


def frame(t_s: float) -> KeptFrame:
    return KeptFrame("", 1, t_s, Pose(LatLon(47.3, 8.5), 12.0, Quaternion(1, 0, 0, 0)), 80.0)


class Usage(NamedTuple):
    free: int


@pytest.mark.skipif(not FULL.exists(), reason="a device that is always full")
def test_picture_without_a_written_pose_is_not_kept(tmp_path):
    lines: list[str] = []
    (tmp_path / FRAMES).mkdir()
    (tmp_path / FRAMES / POSES).symlink_to(FULL)
    keeper = FrameKeeper(tmp_path, lines.append)
    for t_s in (1.0, 2.0, 3.0):
        keeper.keep(frame(t_s), PICTURE)
    assert lines == [f"pictures are kept no longer: {tmp_path / FRAMES}: No space left on device"]
    assert [path.name for path in (tmp_path / FRAMES).iterdir()] == [POSES]


def test_picture_that_cannot_be_written_leaves_the_others_whole(tmp_path, monkeypatch):
    lines: list[str] = []
    keeper = FrameKeeper(tmp_path, lines.append)
    keeper.keep(frame(1.0), PICTURE)
    whole = (tmp_path / FRAMES / POSES).read_bytes()
    note = FrameKeeper._note

    def half(self: FrameKeeper, name: str, kept: KeptFrame) -> None:
        note(self, name, kept)
        with (tmp_path / FRAMES / POSES).open("a") as file:
            file.write("1-000")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(FrameKeeper, "_note", half)
    keeper.keep(frame(2.0), PICTURE)
    keeper.keep(frame(3.0), PICTURE)
    assert len(lines) == 1
    assert (tmp_path / FRAMES / POSES).read_bytes() == whole
    assert len(list((tmp_path / FRAMES).glob("*.jpg"))) == 1
    monkeypatch.undo()
    FrameKeeper(tmp_path, lines.append).keep(frame(2.0), PICTURE)  # as after a resume, with room
    assert [kept.t_s for kept in read_kept(tmp_path) if isinstance(kept, KeptFrame)] == [1.0, 2.0]
    assert len(lines) == 1


def test_list_of_poses_that_is_damaged_stops_no_resume(tmp_path):
    lines: list[str] = []
    (tmp_path / FRAMES).mkdir()
    (tmp_path / FRAMES / POSES).write_bytes(b"\xff\xfe\x00garbage")
    FrameKeeper(tmp_path, lines.append).keep(frame(1.0), PICTURE)
    (line,) = lines
    assert line.endswith(f"{POSES} cannot be read; move {tmp_path / FRAMES} away")
    assert len(list((tmp_path / FRAMES).iterdir())) == 1


def test_last_room_on_the_disk_is_left_to_the_journal(tmp_path, monkeypatch):
    left = iter(range(ROOM_MIB * 2**20 + 100_000, 0, -20_000))  # each of them takes some room
    monkeypatch.setattr(shutil, "disk_usage", lambda path: Usage(next(left)))
    lines: list[str] = []
    keeper = FrameKeeper(tmp_path, lines.append)
    for second in range(9):
        keeper.keep(frame(float(second)), PICTURE)
    (line,) = lines
    assert line.endswith(f"less than {ROOM_MIB} MiB are left on the disk")
    assert len(list((tmp_path / FRAMES).glob("*.jpg"))) == 5
