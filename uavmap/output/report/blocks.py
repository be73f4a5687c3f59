"""The blocks of the two pages of a PDF: texts, tables and drawings, one below the other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final
from xml.sax.saxutils import escape

from reportlab.lib.colors import Color
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.platypus import Flowable, KeepInFrame, Paragraph, Spacer, Table

from uavmap.base.printable import printable
from uavmap.output.drawing import pdf
from uavmap.output.drawing.palette import FAINT, INK, Colour
from uavmap.output.drawing.pdf import BOLD, FONT, Spot, printed
from uavmap.output.drawing.scene import Shape, View

WIDE_PT, HIGH_PT = A4
EDGE_PT: Final = 42.0
ACROSS_PT: Final = WIDE_PT - 2 * EDGE_PT
GAP_PT: Final = 9.0
_RULE: Final[Colour] = (201, 205, 209)
_WARNING: Final[Colour] = (138, 28, 44)
_ALERT: Final[Colour] = (253, 243, 229)
_LETTERS: Final = 300
"""Maximum length of a text, which may come from outside."""


def _colour(colour: Colour) -> Any:
    return Color(*(part / 255.0 for part in colour))


def _style(size_pt: float, colour: Colour = INK, font: str = FONT) -> Any:
    return ParagraphStyle(
        f"{font} {size_pt}", fontName=font, fontSize=size_pt, leading=1.3 * size_pt,
        textColor=_colour(colour), splitLongWords=1,
    )  # fmt: skip


PLAIN: Final = _style(8.5)
FAINT_TEXT: Final = _style(8.0, FAINT)
TITLE: Final = _style(19.0, font=BOLD)
LARGE: Final = _style(16.0, font=BOLD)
HEADING: Final = _style(10.5, font=BOLD)
STATE: Final = _style(10.5)
WARNING_STATE: Final = _style(10.5, _WARNING, BOLD)
WARNING: Final = _style(8.5, _WARNING)
_CELL: Final = _style(7.8)
_CELL_HEAD: Final = _style(7.8, FAINT)
BARE: Final = [
    ("LEFTPADDING", (0, 0), (-1, -1), 0),
    ("RIGHTPADDING", (0, 0), (-1, -1), 6),
    ("TOPPADDING", (0, 0), (-1, -1), 0.8),
    ("BOTTOMPADDING", (0, 0), (-1, -1), 0.8),
    ("VALIGN", (0, 0), (-1, -1), "TOP"),
]
"""The style of a table without lines."""


def text(words: str, style: Any = PLAIN, link: str | None = None, letters: int = _LETTERS) -> Any:
    """Create a paragraph of plain text, cut to a number of letters, with a `link` at its end."""
    safe = escape(printed(printable(words, letters)))
    if link is not None:
        safe = f'{safe} <link href="{escape(link)}"><u>map</u></link>'
    return Paragraph(safe, style)


def heading(words: str) -> list[Any]:
    """Create the heading of a part."""
    line = Table([[text(words, HEADING)]], colWidths=[ACROSS_PT], hAlign="LEFT", style=[
        *BARE, ("LINEBELOW", (0, 0), (-1, -1), 0.6, _colour(_RULE)),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 2),
    ])  # fmt: skip
    return [Spacer(1, GAP_PT), line, Spacer(1, 3)]


def facts_table(rows: Iterable[tuple[str, Any]], wide_pt: float = ACROSS_PT) -> Any:
    """Create a table of names and values; a value is a text or a paragraph."""
    name_pt = min(112.0, 0.34 * wide_pt)
    made = [
        [text(name, _CELL_HEAD), text(value, _CELL) if isinstance(value, str) else value]
        for name, value in rows
    ]
    return Table(made, colWidths=[name_pt, wide_pt - name_pt], style=BARE, hAlign="LEFT")


def list_table(
    heads: Sequence[str], rows: Iterable[Sequence[object]], widths: Sequence[float]
) -> Any:
    """Create a table with a head; `widths` are shares of the page's width."""
    made = [
        [text(head, _CELL_HEAD) for head in heads],
        *([text(str(value), _CELL) for value in row] for row in rows),
    ]
    scale = ACROSS_PT / sum(widths)
    style = [*BARE, ("LINEBELOW", (0, 0), (-1, 0), 0.6, _colour(_RULE))]
    return Table(made, colWidths=[scale * width for width in widths], style=style, hAlign="LEFT")


def beside(columns: Sequence[list[Any]], widths_pt: Sequence[float]) -> Any:
    """Put columns of blocks beside each other."""
    return Table([list(columns)], colWidths=list(widths_pt), style=BARE, hAlign="LEFT")


def alert(lines: Iterable[str]) -> Any:
    """Create the box with the lines that the reader needs first."""
    style = [
        ("BACKGROUND", (0, 0), (-1, -1), _colour(_ALERT)),
        ("LINEBEFORE", (0, 0), (0, -1), 3, _colour(_WARNING)),
        ("LEFTPADDING", (0, 0), (-1, -1), 9),
        ("TOPPADDING", (0, 0), (-1, -1), 2.5),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 2.5),
    ]
    return Table(
        [[text(line)] for line in lines], colWidths=[ACROSS_PT], style=style, hAlign="LEFT"
    )


class Drawing(Flowable):  # type: ignore[misc]
    """A block of shapes with a width."""

    def __init__(self, view: View, shapes: Sequence[Shape], wide_pt: float = ACROSS_PT) -> None:
        super().__init__()
        self._scale = wide_pt / view.width_px
        self._view, self._shapes = view, shapes
        self.width, self.height = wide_pt, view.height_px * self._scale

    def draw(self) -> None:
        """Draw the shapes; reportlab calls this after it has set the canvas."""
        pdf.draw(self.canv, self._shapes, self._view, Spot(0.0, self.height, self._scale))


def height_of(blocks: Sequence[Any], wide_pt: float = ACROSS_PT) -> float:
    """Return the height of a column of blocks, points."""
    return float(sum(block.wrap(wide_pt, HIGH_PT)[1] for block in blocks))


def draw_column(page: Any, blocks: Sequence[Any], top_pt: float, most_pt: float) -> float:
    """Draw a column of blocks, shrunk to a height; return its lower end, points."""
    kept = KeepInFrame(ACROSS_PT, most_pt, list(blocks), mode="shrink")
    _, high_pt = kept.wrapOn(page, ACROSS_PT, most_pt)
    kept.drawOn(page, EDGE_PT, top_pt - high_pt)
    return top_pt - float(high_pt)
