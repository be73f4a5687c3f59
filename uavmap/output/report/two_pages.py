"""report.pdf: two pages A4, by reportlab (the extra `pdf`).

The first page has the findings with the map, the second one the course of the flight. The map and
the judged picture fill the room that is left.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

from PIL import Image as PillowImage
from reportlab import rl_config
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import Image, Spacer

from uavmap.base.version import __version__
from uavmap.output.drawing import pdf, sheet
from uavmap.output.drawing.judged import FILE as JUDGED
from uavmap.output.drawing.mosaic_file import Ground
from uavmap.output.drawing.palette import FAINT, INK, Style
from uavmap.output.drawing.pdf import Spot, printed
from uavmap.output.drawing.scene import Entry, Label, Line, Shape, View
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.report import facts, words
from uavmap.output.report.blocks import (
    ACROSS_PT,
    EDGE_PT,
    FAINT_TEXT,
    GAP_PT,
    HIGH_PT,
    LARGE,
    PLAIN,
    STATE,
    TITLE,
    WARNING,
    WARNING_STATE,
    WIDE_PT,
    Drawing,
    alert,
    beside,
    draw_column,
    facts_table,
    heading,
    height_of,
    list_table,
    text,
)
from uavmap.output.report.map_figure import CORNER_HEADS, map_figure
from uavmap.output.report.pictures import small_jpeg
from uavmap.output.report.timeline import timeline

# without ASCII85: it would make streams a quarter larger, and plain Python would encode them
rl_config.useA85 = 0

_TOP_PT: Final = HIGH_PT - 36.0
_LOW_PT: Final = 46.0
"""Lower end of the content of a page, points; the foot is below it."""
_HEAD_PT: Final = 330.0
"""Maximum height of the blocks above the map, points."""
_PX_PT: Final = 0.62
"""Size of a pixel of map and timeline, points: their letters have 11 to 13 px."""
_TIMELINE_PX: Final = 180.0
"""Height of a timeline of few vehicles, px."""
_LEGEND_PX: Final = 13.0
_PICTURE_PX: Final = 1000
_PICTURE_PT: Final = 260.0
"""Minimum height of a judged picture that is as wide as the page, points."""
_MIN_PT: Final = 72.0
"""Minimum height of a judged picture beside the facts, points."""
_SIGNED_PT: Final = 52.0
_MAX_UNKNOWNS: Final = 6
_MAX_VEHICLES: Final = 8
_MAX_PIECES: Final = 8
_MAX_TROUBLES: Final = 6
_MAX_LETTERS: Final = 160
"""Maximum length of the text of a fault, letters."""


def encode(flown: FlownMission) -> bytes:
    """Write the two pages; equal results give equal bytes."""
    pdf.load_fonts()
    buffer = io.BytesIO()
    page = Canvas(buffer, pagesize=(WIDE_PT, HIGH_PT), invariant=1, pageCompression=1, lang="en")
    page.setTitle(printed(f"{flown.data.mission}: report"))
    page.setSubject(printed(words.outcome(flown)))
    page.setCreator(f"uavmap {__version__}")
    for number, filled in enumerate((_first, _second), start=1):
        filled(page, flown)
        _foot(page, flown, number)
        page.showPage()
    page.save()
    return buffer.getvalue()


def _foot(page: Any, flown: FlownMission, number: int) -> None:
    left = f"{flown.data.mission}  ·  made by uavmap {__version__}"
    shapes = [
        Label((0.0, 0.0), left, 7.5, FAINT),
        Label((ACROSS_PT, 0.0), f"page {number} of 2", 7.5, FAINT, "end"),
    ]
    pdf.draw(page, shapes, View.page(1, 1), Spot(EDGE_PT, 30.0, 1.0))


# --- the first page: what was found ---------------------------------------------------------------
def _first(page: Any, flown: FlownMission) -> None:
    top_pt = draw_column(page, [*_head(flown), *_size(flown)], _TOP_PT, _HEAD_PT) - GAP_PT
    figure = map_figure(flown)
    rows = list(_legend_rows(figure.scene.legend))
    legend_pt = len(rows) * sheet.LEGEND_ROW_PX * _PX_PT
    notes = [text(words.map_note(flown, figure.true_north_deg), FAINT_TEXT)]
    notes_pt = height_of(notes)
    high_pt = top_pt - _LOW_PT - legend_pt - notes_pt - GAP_PT
    wide_px = int(ACROSS_PT / _PX_PT - sheet.LEFT_PX - sheet.RIGHT_PX)
    high_px = int(high_pt / _PX_PT - sheet.ABOVE_PX - sheet.BELOW_PX)
    figure = map_figure(flown, (wide_px, high_px))
    ground = Ground.read(flown.folder, flown.data.grid)
    photograph = None if ground is None else ground.beneath(pdf.finer(figure.scene.view))
    corner = Spot(EDGE_PT + sheet.LEFT_PX * _PX_PT, top_pt - sheet.ABOVE_PX * _PX_PT, _PX_PT)
    pdf.draw_map(page, figure.scene, figure.lines, figure.labels, photograph, corner)
    low_pt = top_pt - high_pt
    pdf.draw(page, _legend(rows), View.page(1, 1), Spot(EDGE_PT, low_pt, _PX_PT))
    draw_column(page, notes, low_pt - legend_pt - 2.0, notes_pt + 2.0)


def _head(flown: FlownMission) -> Iterator[Any]:
    yield text(flown.data.mission, TITLE)
    yield text(words.outcome(flown), STATE if flown.completed else WARNING_STATE)
    if flown.simulated:
        yield text(words.SIMULATED, WARNING)
    yield Spacer(1, GAP_PT)
    found = words.unknowns(flown)
    if len(found) > _MAX_UNKNOWNS:
        found[_MAX_UNKNOWNS:] = [f"{len(found) - _MAX_UNKNOWNS} more in report.html."]
    if found:
        yield alert(found)
        yield Spacer(1, GAP_PT)


def _size(flown: FlownMission) -> Iterator[Any]:
    size, somewhere = words.size(flown), words.middle_place(flown)
    left = [text("Area of the region", FAINT_TEXT)]
    if size is None:
        left.append(text("none found", LARGE))
    else:
        left += [text(size.area, LARGE), text(size.between), text(size.how)]
    left += [text(line) for line in words.class_lines(flown)]
    right = facts_table(
        [
            *words.dates(flown),
            (somewhere.name, text(somewhere.degrees, PLAIN, somewhere.link)),
            ("UTM", somewhere.utm),
            ("Coordinates", words.reference(flown)),
        ],
        0.54 * ACROSS_PT,
    )
    yield beside([left, [right]], (0.46 * ACROSS_PT, 0.54 * ACROSS_PT))


def _legend_rows(entries: Iterable[Entry]) -> Iterator[list[tuple[float, Entry]]]:
    """Yield the entries of each row of a legend, with their columns in pixels."""
    row, left = list[tuple[float, Entry]](), 0.0
    for entry in entries:
        wide = sheet.SAMPLE_PX + 8.0 + pdf.width_px(entry.text, _LEGEND_PX)
        if row and left + wide > ACROSS_PT / _PX_PT:
            yield row
            row, left = [], 0.0
        row.append((left, entry))
        left += wide + 22.0
    if row:
        yield row


def _legend(rows: Sequence[Sequence[tuple[float, Entry]]]) -> Iterator[Shape]:
    for number, row in enumerate(rows):
        middle = (number + 0.5) * sheet.LEGEND_ROW_PX
        for left, entry in row:
            yield from sheet.legend_sample(entry, left, middle)
            yield Label((left + sheet.SAMPLE_PX + 8.0, middle), entry.text, _LEGEND_PX, INK)


# --- the second page: how -------------------------------------------------------------------------
def _second(page: Any, flown: FlownMission) -> None:
    above = [*_times(flown), *_pieces(flown), *_corners(flown)]
    room_pt = _TOP_PT - _LOW_PT - _SIGNED_PT
    draw_column(page, [*above, *_judging(flown, room_pt - height_of(above))], _TOP_PT, room_pt)
    _signature(page)


def _times(flown: FlownMission) -> Iterator[Any]:
    yield from heading("Pictures" if flown.recorded else "Times and aircraft")
    taken = words.dates(flown) if flown.recorded else []  # a flight has dates in axis and table
    found = [*taken, *words.pictures(flown), *facts.flight_facts(flown)]
    middle = (len(found) + 1) // 2
    half_pt = 0.5 * ACROSS_PT
    columns = [[facts_table(part, half_pt)] for part in (found[:middle], found[middle:]) if part]
    yield beside(columns, [half_pt] * len(columns))
    rows = list(facts.vehicle_rows(flown))
    row_px = min(max(_TIMELINE_PX / max(len(rows), 1), 44.0), 90.0)
    drawn = timeline(flown, ACROSS_PT / _PX_PT, row_px, _MAX_VEHICLES)
    if drawn is None:
        return
    yield Spacer(1, 4)
    yield Drawing(drawn.view, drawn.shapes)
    yield text(words.TIMELINE, FAINT_TEXT)
    yield Spacer(1, 4)
    heads = facts.VEHICLE_HEADS
    yield list_table(heads, rows[:_MAX_VEHICLES], (1.0, 0.9, 2.3, 2.3, 1.3, 1.35, 1.2, 1.0))
    yield from _more(len(rows) - _MAX_VEHICLES)


def _pieces(flown: FlownMission) -> Iterator[Any]:
    rows = list(facts.piece_rows(flown))
    if len(rows) < 2:
        return
    yield from heading("Pieces of the region")
    yield list_table(facts.PIECE_HEADS, rows[:_MAX_PIECES], (0.5, 1.0, 1.8, 1.0, 1.0, 2.6))
    yield from _more(len(rows) - _MAX_PIECES)


def _corners(flown: FlownMission) -> Iterator[Any]:
    yield from heading("Corners of the map")
    rows = [corner.row() for corner in map_figure(flown).corners]
    yield list_table(CORNER_HEADS, rows, (0.8, 1.5, 1.5, 1.5, 1.5))


def _more(count: int) -> Iterator[Any]:
    if count > 0:
        yield text(f"{count} more in report.html.", FAINT_TEXT)


def _judging(flown: FlownMission, room_pt: float) -> Iterator[Any]:
    """Yield the judged and the unjudged ground, and a judged picture in the room that is left."""
    half_pt = 0.5 * ACROSS_PT
    left = [text(words.detector(flown)), Spacer(1, 3), facts_table(words.judged(flown), half_pt)]
    right = [text("Not done, with reasons", FAINT_TEXT)]
    right += [text(line, letters=_MAX_LETTERS) for line in words.left_undone(flown, _MAX_TROUBLES)]
    start, columns = heading("Judging, and work not done"), (half_pt, half_pt)
    caption = text(words.JUDGED, FAINT_TEXT)
    left_pt = room_pt - height_of([*start, beside([left, right], columns)]) - GAP_PT
    caption_pt = height_of([caption], half_pt)
    yield from start
    if left_pt >= _PICTURE_PT:
        yield beside([left, right], columns)
        if picture := _picture(flown, ACROSS_PT, left_pt - caption_pt):
            yield from (Spacer(1, 4), picture, caption)
        return
    inside_pt = half_pt - 6.0
    free_pt = left_pt + height_of(left, inside_pt) - height_of(right, inside_pt) - caption_pt
    if picture := _picture(flown, half_pt - 12.0, max(free_pt - 12.0, _MIN_PT)):
        right += [Spacer(1, 6), picture, caption]
    yield beside([left, right], columns)


def _picture(flown: FlownMission, wide_pt: float, high_pt: float) -> Any:
    data = small_jpeg(flown.folder / JUDGED, _PICTURE_PX)
    if data is None:
        return None
    with PillowImage.open(io.BytesIO(data)) as image:
        across, down = image.size
    scale = min(wide_pt / across, high_pt / down)
    return Image(io.BytesIO(data), across * scale, down * scale, hAlign="LEFT")


def _signature(page: Any) -> None:
    """Draw the lines on which a person signs."""
    shapes: list[Shape] = []
    wide = ACROSS_PT / 3.0
    for number, name in enumerate(("checked by", "place, date", "signature")):
        left = number * wide
        shapes.append(Line.through([(left, 0.0), (left + wide - 14.0, 0.0)], Style(INK, 0.6)))
        shapes.append(Label((left, 8.0), name, 7.5, FAINT))
    pdf.draw(page, shapes, View.page(1, 1), Spot(EDGE_PT, _LOW_PT + 14.0, 1.0))
