"""The picture of an exploration tree: on the ground, and by depth with its backbone straight."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from missions.errors import OutputError
from missions.mapping.tree import Tree
from missions.units import Cell
from uavmap.output.documents import save
from uavmap.output.drawing import palette
from uavmap.output.drawing.palette import Colour, Style
from uavmap.output.drawing.raster import encode_png, picture, text_width
from uavmap.output.drawing.scene import (
    Box,
    Dot,
    Entry,
    Label,
    Line,
    Place,
    Shape,
    View,
    bounds_of,
)
from uavmap.output.drawing.sheet import legend_row, legend_row_width, step_up
from uavmap.output.drawing.svg import document
from uavmap.output.film.film_writers import DRAWINGS, check_path

BACKBONE: Colour = (0, 90, 200)
RIB: Colour = (148, 158, 168)
GROUND: Colour = (238, 240, 242)
MARGIN_PX: Final = 24
HEAD_PX: Final = 92
FOOT_PX: Final = 44
_PANEL_PX: Final = 560
_LARGEST_PX: Final = 4000
_GAP_PX: Final = 48
_LABEL_PX: Final = 30
_WIDEST_PX: Final = 34.0
_NARROWEST_PX: Final = 4.0
"""Minimum distance of two vertices, px."""


def draw_tree(tree: Tree, path: Path, *, title: str) -> None:
    """Draw a tree into a PNG or SVG file, by the end of the name. Raises `OutputError`.

    The left part shows the tree on the ground, grid north up. The right part shows it by depth,
    with the backbone in a line and the ribs beside it. Vertices have the colours of their states;
    a ring marks the root.
    """
    check_path(path, DRAWINGS)
    size, shapes = tree_shapes(tree, title)
    view = View.page(*size)
    if path.suffix.lower() == ".svg":
        save(path, document(view, shapes).encode())
    else:
        save(path, encode_png(picture(view, shapes)))


def tree_shapes(tree: Tree, title: str) -> tuple[tuple[int, int], list[Shape]]:
    """Return the size of the picture and its shapes. Raises `OutputError` for a large tree."""
    spine = backbone(tree)
    ground, ground_step = _on_ground(tree)
    depths, depth_step = _by_depth(tree)
    ground_size = _move(ground, (MARGIN_PX, HEAD_PX), ground_step)
    right = MARGIN_PX + ground_size[0] + _GAP_PX
    depth_size = _move(depths, (right, HEAD_PX + _LABEL_PX), depth_step)
    branches = len(ribs(tree, spine))
    caption = "   ·   ".join((
        "1 vertex" if len(tree) == 1 else f"{len(tree)} vertices",
        f"depth of the tree, depth_T = {tree.depth}",
        f"backbone of {len(spine)}, {'1 rib' if branches == 1 else f'{branches} ribs'}",
    ))  # fmt: skip
    width = max(
        right + depth_size[0] + MARGIN_PX,
        2 * MARGIN_PX + text_width(caption, 14),
        2 * MARGIN_PX + text_width(title, 20),
        2 * MARGIN_PX + legend_row_width(_legend(tree)),
    )
    height = HEAD_PX + max(ground_size[1], depth_size[1] + _LABEL_PX) + FOOT_PX
    if max(width, height) > _LARGEST_PX:
        raise OutputError(
            f"a tree of {len(tree)} vertices and depth {tree.depth} is too large to draw"
        )
    half, side = ground_step / 2, ground_step - (1.0 if ground_step >= 6.0 else 0.0)
    tiles = (
        Box((x - half, y - half), (x - half + side, y - half + side), GROUND)
        for x, y in ground.values()
    )
    shapes: list[Shape] = [
        Label((MARGIN_PX, 29), title, 20, palette.INK),
        Label((MARGIN_PX, 57), caption, 14, palette.FAINT),
        *tiles,
        *_edges(tree, spine, ground, ground_step),
        *_vertices(tree, ground, ground_step),
        *_ruler(depths, spine, HEAD_PX + _LABEL_PX - 14),
        *_edges(tree, spine, depths, depth_step),
        *_vertices(tree, depths, depth_step),
        *legend_row(_legend(tree), MARGIN_PX, height - 20),
    ]
    return (round(width), round(height)), shapes


# --- where the vertices are ------------------------------------------------------------------
def _on_ground(tree: Tree) -> tuple[dict[Cell, Place], float]:
    west, south, east, north = bounds_of(tree.vertices)
    across, up = east - west + 1, north - south + 1
    step = min(max(_PANEL_PX // max(across, up), _NARROWEST_PX), _WIDEST_PX)
    return {cell: (cell.east * step, -cell.north * step) for cell in tree.vertices}, step


def _by_depth(tree: Tree) -> tuple[dict[Cell, Place], float]:
    spots = spread(tree)
    rows = [spot.row for spot in spots.values()]
    tall = max(rows) - min(rows) + 1
    step_x = min(max(_PANEL_PX * 1.4 / (tree.depth + 1), _NARROWEST_PX), _WIDEST_PX)
    step_y = min(max(_PANEL_PX / tall, _NARROWEST_PX), 0.7 * _WIDEST_PX)
    places = {cell: (spot.depth * step_x, spot.row * step_y) for cell, spot in spots.items()}
    return places, min(step_x, step_y)


def _move(places: dict[Cell, Place], corner: Place, step: float) -> tuple[float, float]:
    """Move the vertices to half a step from a corner; return the size."""
    xs, ys = zip(*places.values(), strict=True)
    left, top = corner[0] + step / 2 - min(xs), corner[1] + step / 2 - min(ys)
    for cell, (x, y) in places.items():
        places[cell] = (x + left, y + top)
    return max(xs) - min(xs) + step, max(ys) - min(ys) + step


# --- what is drawn ---------------------------------------------------------------------------
def _edges(
    tree: Tree, spine: tuple[Cell, ...], places: Mapping[Cell, Place], step: float
) -> Iterator[Shape]:
    """Draw the edges of the ribs, and over them the backbone as one line."""
    on_spine = set(spine)
    for cell, vertex in tree.vertices.items():
        if vertex.parent is not None and cell not in on_spine:
            edge = places[vertex.parent], places[cell]
            yield Line.through(edge, Style(RIB, max(0.07 * step, 1.0)))
    if len(spine) > 1:
        style = Style(BACKBONE, max(0.2 * step, 2.0))
        yield Line.through((places[cell] for cell in spine), style)


def _vertices(tree: Tree, places: Mapping[Cell, Place], step: float) -> Iterator[Shape]:
    radius = 0.24 * step
    for cell, place in places.items():
        disc = (radius, palette.STATES[tree.state(cell).value])
        yield Dot(place, ((radius + 1.0, palette.PAPER), disc) if step >= 8.0 else (disc,))
    yield Dot(places[tree.root], _root(radius))


def _root(radius: float) -> tuple[tuple[float, Colour], ...]:
    discs = ((1.7, palette.INK), (1.3, palette.PAPER), (0.9, palette.INK))
    return tuple((max(r * radius, 4.0 * r / 1.7), colour) for r, colour in discs)


def _ruler(places: Mapping[Cell, Place], spine: tuple[Cell, ...], y: float) -> Iterator[Shape]:
    last = len(spine) - 1
    room = (places[spine[-1]][0] - places[spine[0]][0]) / max(last, 1)
    every = max(round(step_up(30.0 / room)), 1) if last else 1
    for depth in range(0, last + 1, every):
        text = "depth 0" if depth == 0 else str(depth)
        x = places[spine[depth]][0]
        if depth == 0 or x - places[spine[0]][0] > 52.0:
            yield Label((x, y - 4.0), text, 12, palette.FAINT, "middle" if depth else "start")


def _legend(tree: Tree) -> Iterator[Entry]:
    states = [tree.state(cell).value for cell in tree.vertices]
    for state, colour in palette.STATES.items():
        if state in states:
            yield Entry(((5.5, colour),), f"{palette.STATE_NAMES[state]} ({states.count(state)})")
    yield Entry(Style(BACKBONE, 4.0), "backbone")
    if len(tree) > tree.depth + 1:
        yield Entry(Style(RIB, 2.0), "rib")
    yield Entry(_root(4.0), "root")


# --- backbone and ribs ---------------------------------------------------------------------------
def backbone(tree: Tree) -> tuple[Cell, ...]:
    """Return the longest path from the root to a leaf; if there are several, to the least cell.

    >>> tree = Tree.rooted(Cell(0, 0)).with_observation(Cell(0, 0), [Cell(1, 0), Cell(0, 1)])
    >>> backbone(tree.with_observation(Cell(1, 0), [Cell(2, 0)]))[-1]
    Cell(east=2, north=0)
    """
    end = min(tree.vertices, key=lambda cell: (-tree.vertices[cell].depth, cell))
    return tuple(reversed(list(tree.path_up(end))))


def ribs(tree: Tree, spine: tuple[Cell, ...]) -> tuple[Cell, ...]:
    """Return the roots of the ribs, by the depth at which they leave the backbone.

    >>> tree = Tree.rooted(Cell(0, 0)).with_observation(Cell(0, 0), [Cell(1, 0), Cell(0, 1)])
    >>> ribs(tree, (Cell(0, 0), Cell(0, 1)))
    (Cell(east=1, north=0),)
    """
    on_spine = set(spine)
    return tuple(child for cell in spine for child in tree.children(cell) if child not in on_spine)


class Spot(NamedTuple):
    """A vertex in a drawing by depth: its depth, and its row beside the backbone."""

    depth: int
    row: int


def spread(tree: Tree) -> Mapping[Cell, Spot]:
    """Place every vertex: the backbone straight along row 0, the ribs on both sides.

    From the far end towards the root, every rib is placed outside of the others, on the nearer
    side. Likewise its own ribs are on one side of its longest path, so no two edges cross.
    """
    rows = _layout(tree, backbone(tree), _heights(tree), (1, -1))
    return {cell: Spot(tree.vertices[cell].depth, row) for cell, row in rows.items()}


def _layout(
    tree: Tree, path: tuple[Cell, ...], heights: Mapping[Cell, int], sides: tuple[int, ...]
) -> dict[Cell, int]:
    """Return rows for the tree below `path`: 0 along it, with each rib outside of the others."""
    rows = dict.fromkeys(path, 0)
    outer: dict[int, dict[int, int]] = {side: defaultdict(int) for side in sides}
    for rib in reversed(ribs(tree, path)):
        longest = [rib]
        while children := tree.children(longest[-1]):
            longest.append(max(children, key=lambda cell: heights[cell]))
        below = {
            (cell, tree.vertices[cell].depth): row
            for cell, row in _layout(tree, tuple(longest), heights, (1,)).items()
        }
        away = {  # the least row of the rib outside of the others
            side: max(outer[side][depth] + 1 - row for (_, depth), row in below.items())
            for side in sides
        }
        side = min(sides, key=lambda side: away[side])
        for (cell, depth), row in below.items():
            rows[cell] = side * (row + away[side])
            outer[side][depth] = max(outer[side][depth], row + away[side])
    return rows


def _heights(tree: Tree) -> dict[Cell, int]:
    """Return the number of edges of the longest path down from each vertex."""
    heights: dict[Cell, int] = {}
    for cell in sorted(tree.vertices, key=lambda cell: -tree.vertices[cell].depth):
        heights[cell] = max((heights[child] + 1 for child in tree.children(cell)), default=0)
    return heights
