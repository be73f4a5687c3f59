"""The page to paint examples on: only for who has its address, and its masks teach."""

from __future__ import annotations

import http.client
import io
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

from missions.errors import ImageError
from uavmap.photos.tune.examples import load_examples
from uavmap.photos.tune.paint_page import MOST_BYTES, Easel, served


@pytest.fixture
def easel(tmp_path: Path) -> Easel:
    images, masks = tmp_path / "images", tmp_path / "masks"
    images.mkdir()
    masks.mkdir()
    rng = np.random.default_rng(2)
    for name in ("a", "b"):
        picture = Image.fromarray(rng.integers(0, 255, (60, 80, 3), dtype=np.uint8))
        picture.save(images / f"{name}.jpg")
    return Easel(images, masks, 64)


@pytest.fixture
def address(easel: Easel) -> Iterator[str]:
    with served(easel) as url:
        yield url


def asked(
    method: str, url: str, body: bytes | None = None, headers: dict[str, str] | None = None
) -> tuple[int, bytes]:
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=120)
    try:
        connection.request(method, parts.path, body, headers or {})
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def png(size: tuple[int, int]) -> bytes:
    values = np.zeros((size[1], size[0], 3), np.uint8)
    values[: size[1] // 2] = 255
    out = io.BytesIO()
    Image.fromarray(values).save(out, "PNG")
    return out.getvalue()


def test_what_is_painted_is_an_example(easel: Easel, address: str, tmp_path: Path) -> None:
    status, page = asked("GET", address)
    assert status == 200
    assert b"http://" not in page
    assert b"https://" not in page
    assert asked("GET", f"{address}mask/1")[0] == 404
    status, jpeg = asked("GET", f"{address}picture/1")
    assert Image.open(io.BytesIO(jpeg)).size == (64, 48)
    assert asked("PUT", f"{address}mask/1", png((64, 48))) == (200, b"saved b.png")
    assert asked("GET", f"{address}mask/1")[0] == 200
    assert asked("GET", f"{address}pictures")[1] == (
        b'[{"name": "a", "painted": false}, {"name": "b", "painted": true}]'
    )
    (example,) = load_examples(tmp_path / "images", easel.masks, 64)
    assert example.known.all()
    assert example.region.mean() == pytest.approx(0.5)
    assert not easel.done.is_set()
    assert asked("POST", f"{address}done")[0] == 200
    assert easel.done.wait(20)


def test_nobody_else_is_answered(easel: Easel, address: str) -> None:
    root = address.rsplit("/", 2)[0]
    for path in ("/", "/x/", "/x/pictures", "/x/mask/0"):
        assert asked("GET", root + path)[0] == 404
    rebound = {"Host": "evil.example:80"}
    assert asked("GET", f"{address}pictures", headers=rebound)[0] == 404
    assert asked("PUT", f"{address}mask/0", png((64, 48)), rebound)[0] == 404
    assert asked("POST", f"{address}done", headers=rebound)[0] == 404
    assert list(easel.masks.iterdir()) == []
    assert not easel.done.is_set()


@pytest.mark.parametrize("path", ["mask/2", "mask/-1", "mask/..%2f..%2fx", "mask/x", "mask", "x/0"])
def test_only_masks_of_the_pictures_are_kept(easel: Easel, address: str, path: str) -> None:
    assert asked("PUT", address + path, png((64, 48)))[0] == 404
    assert list(easel.masks.iterdir()) == []


def test_what_is_no_picture_is_refused(easel: Easel, address: str) -> None:
    assert asked("PUT", f"{address}mask/0", b"no picture")[0] == 422
    huge = {"Content-Length": str(MOST_BYTES + 1)}
    assert asked("PUT", f"{address}mask/0", b"", huge)[0] == 413
    assert list(easel.masks.iterdir()) == []


def test_a_picture_that_is_gone_is_said(
    easel: Easel, address: str, capfd: pytest.CaptureFixture[str]
) -> None:
    easel.pictures[0].unlink()
    (easel.masks / "b.png").mkdir()
    for path in ("picture/0", "mask/1"):
        status, text = asked("GET", address + path)
        assert (status, b"cannot be read" in text) == (422, True)
    assert capfd.readouterr().err == ""


def test_a_browser_that_goes_away_is_no_traceback(
    address: str, capfd: pytest.CaptureFixture[str]
) -> None:
    parts = urlsplit(address)
    with socket.create_connection((parts.hostname or "", parts.port or 0)) as wire:
        # closed with what was sent to it unread: the other side's next read is refused
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        wire.sendall(f"PUT {parts.path}mask/0 HTTP/1.1\r\n".encode())
        wire.sendall(f"Host: {parts.netloc}\r\nContent-Length: 1000\r\n\r\n".encode())
    assert asked("GET", f"{address}pictures")[0] == 200  # after it, in a thread of its own
    assert "Traceback" not in capfd.readouterr().err


def test_masks_do_not_lie_among_the_pictures(tmp_path: Path) -> None:
    for name in ("a.jpg", "a.png"):
        Image.new("RGB", (80, 60)).save(tmp_path / name)
    with pytest.raises(ImageError, match="masks need one of their own"):
        Easel(tmp_path, tmp_path, 64)
    with pytest.raises(ImageError, match="masks need one of their own"):
        load_examples(tmp_path, tmp_path / "." / "", 64)
    with pytest.raises(ImageError, match=r"a\.(jpg|png) and a\.(jpg|png): to which"):
        Easel(tmp_path, tmp_path / "masks", 64)
