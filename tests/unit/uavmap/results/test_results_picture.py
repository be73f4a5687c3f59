"""map.png: pixels at known places have the colours that they should have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from shapely.geometry import Polygon

from missions.units import Cell, GridPoint
from uavmap.results import canvas, legend, picture
from uavmap.results.model import MapData
from uavmap.results.palette import STATES, TRUTH, Colour, track_colour
from uavmap.results.view import view_of

MapMaker = Callable[..., MapData]


def at(image: Image.Image, data: MapData, east_m: float, north_m: float) -> Colour:
    """The colour at a point of the ground."""
    left, top = picture.map_corner_px()
    x, y = view_of(data).pixel(GridPoint(east_m, north_m))
    red, green, blue = image.getpixel((round(left + x), round(top + y)))  # type: ignore[misc]
    return red, green, blue


def near(colour: Colour, other: Colour, tolerance: int = 12) -> bool:
    return max(abs(a - b) for a, b in zip(colour, other, strict=True)) <= tolerance


@pytest.mark.parametrize("cell", [Cell(1, 3), Cell(4, 4), Cell(5, 5), Cell(2, -1)])
@pytest.mark.parametrize("drift_m_s", [0.0, 0.4])
def test_cells_have_the_colour_of_their_state(
    cell: Cell, drift_m_s: float, make_map: MapMaker
) -> None:
    data = make_map(drift_m_s=drift_m_s)
    image = picture.draw(data)
    (state,) = [row.state for row in data.cells if row.cell == cell]
    # a metre off the centre, where no track runs
    east_m, north_m = data.grid.to_fixed(data.grid.centre_of(cell), data.t_s)
    assert near(at(image, data, east_m + 1, north_m - 0.7), STATES[state])


def test_north_is_up_and_east_is_right(make_map: MapMaker) -> None:
    view = view_of(make_map())
    x0, y0 = view.pixel(GridPoint(0, 0))
    assert view.pixel(GridPoint(0, 10))[1] < y0
    assert view.pixel(GridPoint(10, 0))[0] > x0


def test_a_metre_is_as_long_both_ways(make_map: MapMaker) -> None:
    view = view_of(make_map())
    (x0, y0), (x1, y1) = view.pixel(GridPoint(0, 0)), view.pixel(GridPoint(10, -10))
    assert x1 - x0 == pytest.approx(y1 - y0)


def test_the_truth_is_drawn(make_map: MapMaker) -> None:
    data = make_map()
    assert near(at(picture.draw(data), data, 7.0, 8.0), TRUTH, 60)  # an edge of its hole


def test_the_track_is_drawn(make_map: MapMaker) -> None:
    data = make_map()
    image = picture.draw(data)
    ground, track = STATES["explored"], track_colour(0)
    colour = at(image, data, 9.0, 4.0)
    assert abs(colour[0] - track[0]) < abs(colour[0] - ground[0])


def test_cells_and_box_are_in_view(make_map: MapMaker) -> None:
    data = make_map(drift_m_s=0.4, t_s=600.0)
    view = view_of(data)
    places = [data.grid.fixed(place) for place in data.box]
    places += [data.grid.fixed(data.grid.centre(row.cell, data.t_s)) for row in data.cells]
    for x, y in map(view.pixel, places):
        assert 0 < x < view.width_px
        assert 0 < y < view.height_px


def test_the_same_map_gives_the_same_bytes(tmp_path: Path, make_map: MapMaker) -> None:
    for name in ("a.png", "b.png"):
        picture.write(make_map(), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.format == "PNG"
        assert image.size == picture.draw(make_map()).size


@pytest.mark.parametrize("rows", [7, 64])
def test_bands_leave_no_trace(
    rows: int, make_map: MapMaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = make_map(drift_m_s=0.4)
    data = replace(data, boundary=Polygon([(-3.1, -2.2), (14.3, 1.7), (9.9, 17.6), (-1.2, 12.4)]))
    view = view_of(data)
    ground = np.full((view.height_px, view.width_px, 4), 255, np.uint8)
    ground[:, ::3, :3] = 40
    for beneath in (None, lambda _: ground.copy()):
        monkeypatch.setattr(canvas, "_ROWS", rows)
        banded = np.asarray(picture.draw(data, beneath))
        monkeypatch.setattr(canvas, "_ROWS", 10_000)
        assert np.array_equal(banded, np.asarray(picture.draw(data, beneath)))


def test_a_map_of_nothing_still_shows_the_box(empty_map: MapData) -> None:
    assert picture.draw(empty_map).size[0] > 500


@pytest.mark.parametrize("longest_m", [0.03, 1.0, 7.9, 99.0, 4000.0])
def test_scale_bars_are_round_and_fit(longest_m: float) -> None:
    length_m = legend.nice_length_m(longest_m)
    assert longest_m / 2.5 < length_m <= longest_m
    assert f"{length_m:e}"[0] in "125"
