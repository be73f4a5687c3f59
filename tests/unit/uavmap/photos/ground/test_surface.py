"""The blocks of a surface of probabilities are the same whether they are squeezed or not."""

import numpy as np
import pytest

from uavmap.photos.ground import surface
from uavmap.photos.ground.surface import Surface
from vision.raster import UNSEEN, Raster, Window


def filled() -> Surface:
    """Three blocks of levels; the upper right one was seen by nobody."""
    found = Surface(Raster(0.0, 0.0, 0.1, 60, 50))
    levels = np.random.default_rng(1).integers(0, 256, (50, 60), np.uint8)
    levels[:32, 32:] = UNSEEN
    for block in found.raster.whole.blocks(32):
        found.put(block, levels[block.within(Window(0, 0, 50, 60))])
    return found


@pytest.mark.parametrize("most", [0, 1100])
def test_squeezed_blocks_are_what_they_were(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surface, "_SIDE", 32)
    loose = filled()
    monkeypatch.setattr(surface, "_LOOSE_BYTES", most)
    squeezed = filled()
    for one, other in ((loose.blocks(), squeezed.blocks()), (loose.seen(), squeezed.seen())):
        pairs = list(zip(one, other, strict=True))
        assert len(pairs) >= 3
        for (window, levels), (same, told) in pairs:
            assert window == same
            assert np.array_equal(levels, told)
