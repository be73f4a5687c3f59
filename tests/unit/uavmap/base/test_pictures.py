"""Harmful pictures are checked before they are decoded."""

from __future__ import annotations

import io
import random
import resource
import struct
import zlib

import pytest
from PIL import Image

from missions.errors import ImageError
from uavmap.base import image_files as pictures
from uavmap.base.image_files import decoded


def png(width: int, height: int, body: bytes = b"") -> bytes:
    """Return a PNG file that states a size; `body` holds its compressed pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        crc = zlib.crc32(kind + data)
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", crc)

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def bomb(width: int, height: int) -> bytes:
    """Return a black picture, compressed to a thousandth of its size, that can be decoded."""
    squeeze = zlib.compressobj(9)
    row = bytes(1 + 3 * width)
    body = b"".join(squeeze.compress(row) for _ in range(height)) + squeeze.flush()
    return png(width, height, body)


@pytest.mark.parametrize("side", [10_001, 13_300, 60_000, 2**31 - 1])
def test_picture_of_too_many_pixels_is_not_decoded(side, monkeypatch):
    loaded: list[object] = []
    monkeypatch.setattr(Image.Image, "load", loaded.append)
    monkeypatch.setattr("PIL.ImageFile.ImageFile.load", loaded.append)
    with pytest.raises(ImageError, match=r"too many|decompression bomb"):
        decoded(png(side, side), "bomb.png")
    assert loaded == []


def test_decompression_bomb_takes_no_memory():
    data = bomb(13_300, 200)
    data = data[:16] + struct.pack(">II", 13_300, 13_300) + data[24:]  # states that it is square
    crc = zlib.crc32(data[12:29])
    data = data[:29] + struct.pack(">I", crc) + data[33:]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ImageError, match="13300 x 13300 px are too many"):
        decoded(data, "bomb.png")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # kB


def test_picture_of_another_size_is_not_decoded():
    with pytest.raises(ImageError, match=r"the picture is 9000 x 9000 px, the camera 640 x 480"):
        decoded(png(9000, 9000), "large.png", (640, 480))
    out = io.BytesIO()
    Image.new("RGB", (64, 48), "red").save(out, "PNG")
    assert decoded(out.getvalue(), "right.png", (64, 48)).shape == (48, 64, 3)


def test_file_of_too_many_bytes_is_not_opened(monkeypatch):
    monkeypatch.setattr(pictures, "MAX_PICTURE_BYTES", 1000)
    with pytest.raises(ImageError, match="1001 bytes; a picture has at most 1000"):
        decoded(bytes(1001), "x.jpg")


def test_name_of_a_picture_cannot_write_to_a_terminal():
    with pytest.raises(ImageError) as caught:
        decoded(b"no picture", "http://h/\x1b[2J\u202e.jpg")
    assert str(caught.value).isprintable()


def test_damage_of_any_kind_is_an_image_error():
    rng = random.Random(3)
    originals = []
    for kind in ("JPEG", "PNG"):
        out = io.BytesIO()
        Image.effect_noise((48, 32), 60.0).convert("RGB").save(out, kind)
        originals.append(out.getvalue())
    read = refused = 0
    for number in range(600):
        data = bytearray(originals[number % 2])
        for _ in range(rng.randrange(1, 12)):
            at = rng.randrange(len(data) if number % 3 else 200)
            data[at] = rng.randrange(256)
        if number % 5 == 0:
            del data[rng.randrange(4, len(data)) :]
        try:
            image = decoded(bytes(data), "damaged")
        except ImageError:
            refused += 1
        else:
            read += 1
            assert image.ndim == 3
    assert refused > 100
    assert read > 100


@pytest.mark.parametrize("error", [KeyError("x"), IndexError(), MemoryError(), RecursionError()])
def test_any_error_of_a_decoder_is_an_image_error(error, monkeypatch):
    def load(*_: object) -> None:
        raise error

    monkeypatch.setattr("PIL.ImageFile.ImageFile.load", load)
    with pytest.raises(ImageError, match="not a readable picture"):
        decoded(bomb(8, 8), "x.png")
