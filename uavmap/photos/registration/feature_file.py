"""Features of pictures, kept on disk while a set is registered: they are most of its memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavmap.photos.scratch_file import ScratchFile
from vision.registration import Features

_WORDS: int = 128


class FeatureFile(ScratchFile):
    """Features in a file that vanishes with this object; for any thread.

    >>> some = Features(np.array([[1.5, 2.0]]), np.full((1, 128), 7, np.uint8), 320, 240)
    >>> with FeatureFile() as file:
    ...     kept = file.put(some)
    ...     kept.points.tolist(), int(kept.descriptors.sum()), kept.width_px
    ([[1.5, 2.0]], 896, 320)
    """

    def __init__(self) -> None:
        remedy = "have TMPDIR name another folder, or replay with --refine off"
        super().__init__("features of pictures wait", remedy)

    def put(self, features: Features) -> KeptFeatures:
        """Keep features; raises `OutputError` on a full disk."""
        points = features.points.astype(np.float64).tobytes()
        offset = self.append(points, features.descriptors.tobytes())
        size = features.width_px, features.height_px
        return KeptFeatures(self, offset, len(features.points), *size)


@dataclass(frozen=True, slots=True)
class KeptFeatures:
    """`Features` that are read whenever they are asked for."""

    file: FeatureFile
    offset: int
    count: int
    width_px: int
    height_px: int

    @property
    def points(self) -> NDArray[np.float64]:
        """See `Features.points`."""
        return np.frombuffer(self.file.read(self.offset, 16 * self.count)).reshape(-1, 2)

    @property
    def descriptors(self) -> NDArray[np.uint8]:
        """See `Features.descriptors`."""
        data = self.file.read(self.offset + 16 * self.count, _WORDS * self.count)
        return np.frombuffer(data, np.uint8).reshape(-1, _WORDS)
