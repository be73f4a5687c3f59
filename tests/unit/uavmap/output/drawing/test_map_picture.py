"""map.png: pixels at known places have the right colours."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from shapely.geometry import Polygon

from missions.units import Cell, GridPoint
from tests.unit.uavmap.output.maps import empty_map, make_map
from uavmap.output.drawing import svg
from uavmap.output.drawing.map_scene import map_scene, map_view
from uavmap.output.drawing.palette import STATES, TRUTH, Style, css, track_colour
from uavmap.output.drawing.raster import THROUGH, THROUGH_OPAQUE, cell_picture
from uavmap.output.drawing.scene import Cells, View
from uavmap.output.drawing.sheet import MARGIN_PX, TITLE_PX, draw_sheet, step_down, write_sheet


def at(image, data, east_m, north_m):
    left, top = MARGIN_PX, TITLE_PX
    x, y = map_view(data).pixel(GridPoint(east_m, north_m))
    red, green, blue = image.getpixel((round(left + x), round(top + y)))
    return red, green, blue


def near(colour, other, tolerance=12):
    return max(abs(a - b) for a, b in zip(colour, other, strict=True)) <= tolerance


@pytest.mark.parametrize("cell", [Cell(1, 3), Cell(4, 4), Cell(5, 5), Cell(2, -1)])
@pytest.mark.parametrize("drift_m_s", [0.0, 0.4])
def test_cells_have_the_colour_of_their_state(cell, drift_m_s):
    data = make_map(drift_m_s=drift_m_s)
    image = draw_sheet(map_scene(data))
    (state,) = [state for place, state, *_ in data.cells.values() if tuple(place) == cell]
    # a metre off the centre, where no track runs
    east_m, north_m = data.grid.to_fixed(data.grid.centre_of(cell), data.t_s)
    assert near(at(image, data, east_m + 1, north_m - 0.7), STATES[state])


def test_map_has_north_up_and_east_right_at_one_scale():
    view = map_view(make_map())
    (x0, y0), (x1, y1) = view.pixel(GridPoint(0, 0)), view.pixel(GridPoint(10, -10))
    assert x1 - x0 == pytest.approx(y1 - y0)
    assert x1 > x0


def test_truth_and_track_are_drawn():
    data = make_map()
    image = draw_sheet(map_scene(data))
    assert near(at(image, data, 7.0, 8.0), TRUTH, 60)  # an edge of its hole
    ground, track = STATES["explored"], track_colour(0)
    red = at(image, data, 9.0, 4.0)[0]
    assert abs(red - track[0]) < abs(red - ground[0])


def test_cells_and_box_are_in_view():
    assert draw_sheet(map_scene(empty_map())).size[0] > 500
    data = make_map(drift_m_s=0.4, t_s=600.0)
    view = map_view(data)
    places = [data.grid.fixed(place) for place in data.box]
    cells = map(tuple, data.cells.cells.tolist())
    places += [data.grid.fixed(data.grid.centre(Cell(*cell), data.t_s)) for cell in cells]
    for x, y in map(view.pixel, places):
        assert 0 < x < view.width_px
        assert 0 < y < view.height_px


def test_same_map_gives_the_same_bytes(tmp_path):
    for name in ("a.png", "b.png"):
        write_sheet(map_scene(make_map()), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.format == "PNG"
        assert image.size == draw_sheet(map_scene(make_map())).size


def test_photograph_shows_through_cells_and_less_through_the_region():
    scene = map_scene(make_map())
    view = scene.view
    photograph = np.zeros((view.height_px, view.width_px, 4), np.uint8)
    photograph[..., 3] = 255
    box = (MARGIN_PX, TITLE_PX, MARGIN_PX + view.width_px, TITLE_PX + view.height_px)
    sheets = (draw_sheet(scene, over) for over in (photograph, None))
    dark, light = (np.asarray(sheet.crop(box)).astype(int) for sheet in sheets)
    for state, through in (("explored", THROUGH_OPAQUE), ("non-roi", THROUGH)):
        there = (light == STATES[state]).all(axis=2)
        assert there.any()
        left_over = np.median(dark[there] / light[there])
        assert left_over == pytest.approx(1 - through / 255, abs=0.02)


def test_small_cells_keep_their_share_of_a_pixel():
    cells = np.array([(east, north) for east in range(30) for north in range(30)], np.int32)
    codes = (cells.sum(axis=1) % 2).astype(np.uint8)
    board = Cells(
        cells, codes, ((0, 0, 0), (255, 255, 255)), 1.0, GridPoint(0.5, -29.5), (True,) * 2
    )
    image = np.asarray(cell_picture(board, View(0.0, 0.0, 1.0 / 3.0, 10, 10), (9, 9, 9)))
    assert np.abs(image[1:-1, 1:-1].astype(int) - 127).max() < 20


@pytest.mark.parametrize("longest_m", [0.03, 1.0, 7.9, 99.0, 4000.0])
def test_scale_bars_are_round_and_fit(longest_m):
    length_m = step_down(longest_m)
    assert longest_m / 2.51 < length_m <= longest_m
    assert f"{length_m:e}"[0] in "125"


def test_legend_is_drawn_whole_by_both_backends():
    data = make_map()
    data = replace(data, boundary=Polygon([(-3.1, -2.2), (14.3, 1.7), (9.9, 17.6)]))
    scene = map_scene(data)
    texts = [entry.text for entry in scene.legend]
    assert texts[-3:] == ["search box", "geofence", "home"]
    drawn = svg.map_drawing(scene)
    colours = {tuple(colour) for colour in np.asarray(draw_sheet(scene)).reshape(-1, 3).tolist()}
    for entry in scene.legend:
        if isinstance(entry.sample, Style) and not entry.text.startswith("track"):
            assert f'stroke="{css(entry.sample.colour)}"' in drawn
            assert entry.sample.colour in colours
        assert svg.sample(entry).startswith("<svg")
