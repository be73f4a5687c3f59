"""The picture of a tree: backbone and ribs, drawn without a crossing, as PNG and SVG."""

import io
from itertools import combinations, pairwise
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from shapely.geometry import LineString

from missions.errors import OutputError
from missions.mapping.tree import Tree, Vertex
from missions.units import Cell
from tests.unit.uavmap.output.film.runs import START, explored, small_roi, tree_until
from uavmap.output.drawing.palette import STATES
from uavmap.output.film import tree_picture

SVG = "{http://www.w3.org/2000/svg}"


@st.composite
def trees(draw):
    roi = small_roi(draw(st.integers(1, 40)), draw(st.integers(0, 1000)))
    run = explored(roi, draw(st.integers(1, 4)))
    return tree_until(run, roi, draw(st.floats(0.0, 1.0)) * run.makespan)


@settings(max_examples=40, deadline=None)
@given(trees())
def test_tree_consists_of_backbone_and_ribs(tree):
    spine = tree_picture.backbone(tree)
    assert spine[0] == tree.root
    assert not tree.children(spine[-1])
    assert len(spine) == tree.depth + 1
    assert all(tree.parent(below) == above for above, below in pairwise(spine))
    found = list(spine)
    todo = list(tree_picture.ribs(tree, spine))
    assert all(tree.parent(cell) in spine for cell in todo)
    while todo:
        cell = todo.pop()
        found.append(cell)
        todo += tree.children(cell)
    assert sorted(found) == sorted(tree.vertices)


@settings(max_examples=25, deadline=None)
@given(trees())
def test_tree_drawn_by_depth_has_no_crossing_edges(tree):
    spots = tree_picture.spread(tree)
    assert spots.keys() == tree.vertices.keys()
    assert len(set(spots.values())) == len(tree)
    assert all(spot.depth == tree.vertices[cell].depth for cell, spot in spots.items())
    assert {spots[cell].row for cell in tree_picture.backbone(tree)} == {0}
    edges = [
        (LineString([spots[v.parent], spots[cell]]), {cell, v.parent})
        for cell, v in tree.vertices.items()
        if v.parent is not None
    ]
    for (one, ends), (other, their_ends) in combinations(edges, 2):
        if not ends & their_ends:
            assert not one.intersects(other)


def half_explored():
    roi = small_roi(40)
    run = explored(roi)
    return tree_until(run, roi, 0.5 * run.makespan)


def test_png_shows_states_and_backbone_where_they_are(tmp_path):
    tree, path = half_explored(), tmp_path / "tree.png"
    tree_picture.draw_tree(tree, path, title="half way")
    west = min(c.east for c in tree.vertices)
    north = max(c.north for c in tree.vertices)
    up = north - min(c.north for c in tree.vertices) + 1
    across = max(c.east for c in tree.vertices) - west + 1
    step = min(560 // max(up, across), 34)

    def pixel(east, north_):
        x, y = (east - west + 0.5) * step, (north - north_ + 0.5) * step
        return int(tree_picture.MARGIN_PX + x), int(tree_picture.HEAD_PX + y)

    with Image.open(path) as picture:
        for cell in tree.vertices:
            if cell != tree.root:
                assert picture.getpixel(pixel(*cell)) == STATES[tree.state(cell).value]
        spine = tree_picture.backbone(tree)
        for one, other in pairwise(spine):
            middle = pixel((one.east + other.east) / 2, (one.north + other.north) / 2)
            assert picture.getpixel(middle) == tree_picture.BACKBONE


def test_svg_has_every_vertex_twice_and_a_title(tmp_path):
    tree, path = half_explored(), tmp_path / "tree.SVG"
    tree_picture.draw_tree(tree, path, title="half <way> & on")
    drawing = ElementTree.fromstring(path.read_text("utf-8"))
    counts = dict.fromkeys(STATES, 0)
    for disc in drawing.iter(f"{SVG}circle"):
        for state, colour in STATES.items():
            counts[state] += disc.get("fill") == "#{:02x}{:02x}{:02x}".format(*colour)
    states = [tree.state(cell).value for cell in tree.vertices]
    for state, count in counts.items():
        in_legend = state in states
        assert count == 2 * states.count(state) + in_legend
    words = [text.text for text in drawing.iter(f"{SVG}text")]
    assert words[0] == "half <way> & on"
    assert words[1] is not None
    assert f"depth_T = {tree.depth}" in words[1]
    assert f"{len(tree)} vertices" in words[1]


@pytest.mark.parametrize("name", ["tree.png", "tree.svg"])
def test_same_tree_gives_the_same_bytes(tmp_path, name):
    draws = []
    for title in ("one", "one", "other"):
        tree_picture.draw_tree(half_explored(), tmp_path / name, title=title)
        draws.append((tmp_path / name).read_bytes())
    assert draws[0] == draws[1] != draws[2]


def test_tree_of_one_vertex_is_drawn(tmp_path):
    tree_picture.draw_tree(Tree.rooted(START), tmp_path / "one.png", title="one")
    with Image.open(io.BytesIO((tmp_path / "one.png").read_bytes())) as picture:
        assert picture.width > 100
    _, shapes = tree_picture.tree_shapes(Tree.rooted(START), "one")
    assert any("1 vertex " in getattr(shape, "text", "") for shape in shapes)


def test_tree_too_large_to_draw_and_bad_names_are_refused(tmp_path):
    vertices = {
        Cell(i, 0): Vertex(Cell(i - 1, 0) if i else None, i, observed=True) for i in range(2000)
    }
    long = Tree.from_vertices(START, vertices)
    with pytest.raises(OutputError, match="2000 vertices and depth 1999 is too large to draw"):
        tree_picture.draw_tree(long, tmp_path / "long.png", title="long")
    for name, why in {"tree.jpg": "must end in .png or .svg", "no/tree.png": "no folder"}.items():
        with pytest.raises(OutputError, match=why):
            tree_picture.draw_tree(half_explored(), tmp_path / name, title="")
    assert list(tmp_path.iterdir()) == []
