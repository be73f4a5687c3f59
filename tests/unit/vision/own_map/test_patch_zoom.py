"""By how much larger one patch shows the ground than another: rendered from known heights."""

from __future__ import annotations

import pytest

from tests.unit.vision.own_map.test_own_map import taken
from vision.own_map.ground_match import compare, match, resized


@pytest.mark.parametrize("height", [-0.03, 0.0, 0.02])
@pytest.mark.parametrize("turned_rad", [0.0, -0.03])
def test_a_height_or_heading_that_wanders_is_seen(height: float, turned_rad: float) -> None:
    earlier = taken(0.0, 0.0, 0.0, 12.0)
    later = taken(1.5, 4.0, 2.8, 12.0 * (1.0 + height), -turned_rad)
    near = match(earlier, later, (1.5, 4.0), 1.0)
    assert near is not None
    found = compare(earlier, later, complex(*near.moved_m) / 0.2)
    assert found is not None
    zoom = complex(height, turned_rad)
    assert abs(found.zoom - zoom) < 0.004
    assert found.sigma < 0.006
    way_m = complex(1.5, 4.0) * (1.0 + zoom / 2.0)
    assert abs(found.moved_px * 0.2 - way_m) < 0.05


def test_what_is_much_larger_is_found_once_it_is_made_alike() -> None:
    earlier, later = taken(0.0, 0.0, 0.0, 12.0), taken(0.0, 4.0, 2.8, 13.8)
    alike = resized(later, 0.14 + 0j)
    near = match(earlier, alike, (0.0, 4.0), 1.0)
    assert near is not None
    found = compare(earlier, later, complex(*near.moved_m) / 0.2, 0.14 + 0j)
    assert found is not None
    assert found.zoom == pytest.approx(0.15, abs=0.004)


def test_other_ground_has_no_size() -> None:
    here = taken(0.0, 0.0, 0.0, 12.0)
    assert compare(here, taken(15.0, 9.0, 6.3, 12.0), 0j) is None
    assert compare(here, here, complex(0.0, 70.0)) is None
