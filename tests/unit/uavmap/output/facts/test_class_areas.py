"""Areas and litres of the classes of a region, with their bounds."""

from itertools import product

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from missions.classes import Classes
from missions.geo.grid import Grid
from missions.units import LatLon
from uavmap.output.facts.class_areas import class_areas, class_figures

GRID = Grid.at(LatLon(48.0, 11.0), 2.0)
OIL = {
    "thick": {"number": 9, "thickness_um": [200.0]},
    "sheen": {"number": 3, "thickness_um": [0.04, 0.3]},
    "weed": {"number": 5},
    "region": ["thick", "sheen"],
}
CLASSES = Classes.model_validate(OIL)


@given(st.floats(0.6, 12.0), st.floats(0.6, 12.0), st.floats(-0.5, 0.5))
def test_true_area_of_nested_discs_lies_within_the_bounds(outer_m, inner_m, aside_m):
    """A disc of one class in a disc of another; frames saw the exact shares."""
    inner_m = min(inner_m, outer_m)
    thick = shapely.Point(aside_m, 0.3).buffer(inner_m)
    sheen = shapely.Point(0.0, 0.0).buffer(outer_m).difference(thick)
    cells = np.array(list(product(range(-8, 9), repeat=2)), np.int32)
    boxes = shapely.box(*(cells * 2.0 - 1.0).T, *(cells * 2.0 + 1.0).T)
    shares = np.column_stack(
        [shapely.area(shapely.intersection(boxes, film)) / 4.0 for film in (sheen, thick)]
    )
    region = shares.sum(axis=1) >= 0.3
    which = np.where(region, shares.argmax(axis=1), -1)
    found = class_areas(CLASSES, GRID, cells, shares, which)
    assert [one.number for one in found] == [3, 9]
    assert sum(len(one.cells) for one in found) == region.sum()
    for one, film in zip(found, (sheen, thick), strict=True):
        assert one.low_m2 <= film.area + 1e-6
        assert one.high_m2 >= film.area - 1e-6
        assert one.area_m2 == pytest.approx(one.outline.area)
        assert one.low_m2 <= one.area_m2 <= one.high_m2 + 1e-9


def test_volume_is_area_by_thickness_and_unbounded_without_one():
    cells = np.array([[0, 0], [5, 5]], np.int32)
    shares = np.array([[1.0, 0.0], [0.0, 0.5]])
    found = class_areas(CLASSES, GRID, cells, shares, np.array([0, 1]))
    assert found[0].volume_l == pytest.approx((2.0 * 0.04e-3, 4.0 * 0.3e-3))
    assert found[1].volume_l == (pytest.approx(1.0 * 0.2), None)
    told = class_figures(found)
    assert told["volume_l"] == [pytest.approx(0.2, abs=1e-3), None]
    assert [one["name"] for one in told["classes"]] == ["sheen", "thick"]
    assert class_figures(found[:1])["volume_l"] == [0.0, 0.001]
    assert class_figures(()) == {}


def test_class_without_a_thickness_has_no_litres():
    plain = Classes.model_validate({"weed": {"number": 5}})
    cells, shares = np.array([[0, 0]], np.int32), np.array([[1.0]])
    told = class_figures(class_areas(plain, GRID, cells, shares, np.array([0])))
    assert "volume_l" not in told
    assert "volume_l" not in told["classes"][0]
