"""Fields of a learned model beside its parts, for tests that make one by hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from vision.detectors.familiarity import NAMES, QUANTILES, Familiarity, Gaussian, Kind


def all_familiar() -> dict[str, Any]:
    """Return the fields of a model to which every pixel is familiar."""
    side = len(NAMES)
    wide = Gaussian(
        weight=1.0, mean=(0.0,) * side, whitening=tuple(map(tuple, np.eye(side).tolist()))
    )
    densities = tuple(-1e9 + number for number in range(len(QUANTILES)))
    kind = Kind(gaussians=(wide,), densities=densities)
    told = Familiarity(mean=(0.0,) * side, scale=(1.0,) * side, region=kind, surround=kind)
    return {"familiarity": told, "wrong_at_most": 1.0}
