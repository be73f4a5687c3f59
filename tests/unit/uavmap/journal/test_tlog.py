from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.support.mavlink_peer import Peer, heartbeat, text
from uavmap.journal.telemetry_log import TlogWriter

EPOCH_S = 1_577_836_800.0


def read(path: Path) -> list[tuple[float, str, int, int]]:
    """Return (time, type, system, sequence number) of every message that pymavlink reads."""
    log = mavutil.mavlink_connection(str(path), notimestamps=False)
    found = []
    while (message := log.recv_match()) is not None:
        kind = message.get_type()
        found.append((message._timestamp, kind, message.get_srcSystem(), message.get_seq()))
    log.close()
    return found


def test_pymavlink_reads_the_messages_and_their_times(tmp_path):
    peer, path = Peer(system=3), tmp_path / "flight.tlog"
    times_s = [EPOCH_S, EPOCH_S + 0.001, EPOCH_S + 12.345678, EPOCH_S + 4380.5]
    frames = [
        peer.frame(heartbeat(4, armed=True)),
        peer.frame(text("Arming motors")),
        peer.frame(mav.MAVLink_global_position_int_message(5, 1, 2, 3, 4, 5, 6, 7, 8)),
        peer.frame(heartbeat(9)),
    ]
    rest = iter(times_s)
    with TlogWriter(path, lambda: next(rest)) as log:
        for frame in frames:
            log.record(frame)
    found = read(path)
    assert [kind for _, kind, _, _ in found] == [
        "HEARTBEAT",
        "STATUSTEXT",
        "GLOBAL_POSITION_INT",
        "HEARTBEAT",
    ]
    assert [t_s for t_s, *_ in found] == pytest.approx(times_s, abs=2e-6)
    assert [system for *_, system, _ in found] == [3] * 4
    assert [number for *_, number in found] == [0, 1, 2, 3]


def test_append_continues_a_log_and_a_new_one_is_empty(tmp_path):
    peer, path = Peer(), tmp_path / "flight.tlog"
    for append in (False, True, True):
        with TlogWriter(path, lambda: EPOCH_S, append=append) as log:
            log.record(peer.frame(heartbeat()))
    assert len(read(path)) == 3
    with TlogWriter(path, lambda: EPOCH_S) as log:
        log.record(peer.frame(heartbeat()))
    assert len(read(path)) == 1


def test_frames_recorded_before_a_kill_are_whole(tmp_path):
    path = tmp_path / "flight.tlog"
    program = """
        import os, signal, sys
        from pathlib import Path
        from tests.support.mavlink_peer import Peer, text
        from uavmap.journal.telemetry_log import TlogWriter
        peer = Peer()
        log = TlogWriter(Path(sys.argv[1]), lambda: 1577836800.0)
        for number in range(700):
            log.record(peer.frame(text(f"number {number} of many, and some more words")))
        os.kill(os.getpid(), signal.SIGKILL)
    """
    root = Path(__file__).resolve().parents[4]
    command = [sys.executable, "-c", textwrap.dedent(program), str(path)]
    ended = subprocess.run(command, env={**os.environ, "PYTHONPATH": str(root)}, check=False)
    assert ended.returncode == -signal.SIGKILL
    with TlogWriter(path, lambda: EPOCH_S, append=True) as log:
        log.record(Peer().frame(heartbeat()))
    assert [kind for _, kind, *_ in read(path)] == ["STATUSTEXT"] * 700 + ["HEARTBEAT"]


class FullDisk:
    """A file system with limited room."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, room: int) -> None:
        self.room = room
        self._pwrite = os.pwrite
        monkeypatch.setattr(os, "pwrite", self.pwrite)

    def pwrite(self, file: int, data: bytes, place: int) -> int:
        if self.room == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        part = min(self.room, len(data))
        self.room -= part
        return self._pwrite(file, data[:part], place)


@pytest.mark.parametrize("torn", [0, 1, 9, 20])
def test_full_disk_is_reported_once_and_stops_nothing(tmp_path, monkeypatch, torn):
    path, peer, lines = tmp_path / "flight.tlog", Peer(), []
    frames = [peer.frame(heartbeat()) for _ in range(40)]
    record = len(frames[0]) + 8
    disk = FullDisk(monkeypatch, 10 * record + torn)
    now_s = EPOCH_S
    with TlogWriter(path, lambda: now_s, say=lines.append) as log:
        for n, frame in enumerate(frames):
            if n == 30:
                disk.room = 10**6
            log.record(frame)
            now_s += 1.0
        assert len(lines) == 1
        assert log.lost == 20
        assert "cannot be written (No space left on device); the flight goes on" in lines[0]
    assert lines[1:] == [f"{path} lacks 20 frames"]
    numbers = [number for *_, number in read(path)]
    assert numbers == [*range(10), *range(30, 40)]


def test_log_that_cannot_be_opened_or_is_closed_stops_nothing(tmp_path):
    lines: list[str] = []
    now_s = EPOCH_S
    path = tmp_path / "flight.tlog"
    path.mkdir()
    frame = Peer().frame(heartbeat())
    with TlogWriter(path, lambda: now_s, say=lines.append) as log:
        log.record(frame)
        path.rmdir()
        now_s += 10.0
        log.record(frame)
    log.record(frame)
    assert log.lost == 2
    assert lines == [
        f"{path} cannot be written (Is a directory); the flight goes on",
        f"{path} lacks 1 frames",
    ]
    assert len(read(path)) == 1
