"""Work in threads, in order; on a Dask cluster the same bytes, and a line for each fault."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from missions.errors import ImageError, StudyError
from tests.unit.uavmap.photos.sources.test_replay_robust import good
from uavmap.base import extras
from uavmap.photos import workers as module
from uavmap.photos.workers import Cluster, Threads, Travelling
from uavmap.ui.cli import main

__all__ = ["good"]  # a fixture

FILES = ("map.geojson", "map.kml", "map.png", "summary.json", "pictures.csv", "registration.json")


def on_loopback(**more: Any) -> Any:
    distributed = pytest.importorskip("distributed", reason="needs the extra cluster")
    return distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, protocol="tcp://", host="127.0.0.1",
        dashboard_address=None, **{"processes": False, **more},
    )  # fmt: skip


def test_map_of_a_cluster_is_that_of_this_computer(good: Path, tmp_path: Path) -> None:
    (good / "torn.jpg").write_bytes((good / "0.jpg").read_bytes()[:9000])
    line = ["replay", str(good), "--mission", str(good / "m.toml")]
    assert main([*line, "--out", str(tmp_path / "here")]) == 0
    with on_loopback() as cluster:
        there = ["--scheduler", cluster.scheduler_address, "--out", str(tmp_path / "there")]
        assert main([*line, *there]) == 0
    for name in FILES:
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()
    assert "torn.jpg,no" in (tmp_path / "there" / "pictures.csv").read_text()


def dies_once(mark: str) -> str:
    """End the first worker that gets this job."""
    import os  # noqa: PLC0415 - it travels

    path = Path(mark)
    if path.exists():
        path.unlink()
        os._exit(1)
    return "done"


def test_work_of_a_worker_that_died_is_repeated(tmp_path: Path) -> None:
    mark = tmp_path / "die"
    mark.touch()
    with (
        on_loopback(processes=True, silence_logs=50) as cluster,
        Cluster(cluster.scheduler_address) as crew,
    ):
        assert list(crew.in_order(dies_once, [str(mark)] * 3)) == ["done"] * 3
    assert not mark.exists()


def test_cluster_without_workers_and_one_of_another_version_are_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with on_loopback(silence_logs=50) as cluster:
        address = cluster.scheduler_address
        with monkeypatch.context() as patch:
            patch.setattr(module, "_version", lambda: "0.0.1")
            with (
                pytest.raises(StudyError, match=r"has uavmap 0\.0\.1, this computer has"),
                Cluster(address),
            ):
                pass
        cluster.scale(0)
        cluster.sync(cluster._correct_state)
        with pytest.raises(StudyError, match="no worker; start some"), Cluster(address):
            pass


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere"])
def test_missing_scheduler_is_reported_in_a_line(
    address: str,
    good: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(extras, "ANSWER_S", 0.3)
    out = tmp_path / "out"
    assert main(["replay", str(good), "--scheduler", address, "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("uavmap: --scheduler ")
    assert not out.exists()


def test_content_travels_with_its_bytes_or_its_fault() -> None:
    pixels = np.full((4, 6, 3), 7, np.uint8)
    gone = pickle.loads(pickle.dumps(Travelling(b"", 9, fault="cannot be read")))
    with pytest.raises(ImageError, match="cannot be read"):
        gone.decode(100)
    sent = pickle.loads(pickle.dumps(Travelling(pixels, 9)))
    assert (sent.decode(100) == pixels).all()


# --- threads -------------------------------------------------------------------------------------
def test_answers_come_in_the_items_order_and_few_wait() -> None:
    begun: list[int] = []

    def work(number: int) -> int:
        begun.append(number)
        return number

    answers = Threads(3).in_order(work, range(100))
    assert [next(answers) for _ in range(5)] == [0, 1, 2, 3, 4]
    assert len(begun) <= 9
    assert list(answers) == list(range(5, 100))


def test_opencv_has_its_threads_back_after_the_last_user() -> None:
    before = cv2.getNumThreads()
    cv2.setNumThreads(2)
    try:
        one, other = (Threads(2).in_order(abs, range(4)) for _ in range(2))
        next(one)
        next(other)
        assert list(one) == [1, 2, 3]
        assert cv2.getNumThreads() == 1  # the other is still at work
        assert list(other) == [1, 2, 3]
        assert cv2.getNumThreads() == 2
    finally:
        cv2.setNumThreads(before)


def test_error_of_a_worker_is_raised() -> None:
    def work(number: int) -> int:
        return 1 // (2 - number)

    with pytest.raises(ZeroDivisionError):
        list(Threads(2).in_order(work, range(9)))
