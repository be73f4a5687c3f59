"""Features of pictures on disk."""

from pathlib import Path

import numpy as np
import pytest

from missions.errors import OutputError
from uavmap.photos import scratch_file
from uavmap.photos.scratch_file import FeatureFile
from vision.registration.views import Features


def test_features_come_back_as_they_were() -> None:
    rng = np.random.default_rng(3)
    given = [
        Features(rng.normal(size=(n, 2)), rng.integers(0, 256, (n, 128), np.uint8), 320 + n, 240)
        for n in (5, 0, 1200)
    ]
    with FeatureFile() as file:
        kept = [file.put(features) for features in given]
        for found, features in reversed(list(zip(kept, given, strict=True))):
            assert np.array_equal(found.points, features.points)
            assert np.array_equal(found.descriptors, features.descriptors)
            assert (found.width_px, found.height_px) == (features.width_px, features.height_px)


def test_a_full_disk_is_said_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    full = Path("/dev/full")
    monkeypatch.setattr(
        scratch_file.tempfile, "TemporaryFile", lambda **_: full.open("r+b", buffering=0)
    )
    some = Features(np.zeros((1, 2)), np.zeros((1, 128), np.uint8), 320, 240)
    with FeatureFile() as file, pytest.raises(OutputError, match="--refine off"):
        file.put(some)
