"""QGIS styles (QML) of the layers, in the colours of map.png."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from uavmap.output.drawing import palette
from uavmap.output.drawing.palette import Colour
from uavmap.output.formats.layers import Layer

_KINDS = {
    "Point": ("marker", "SimpleMarker"),
    "LineString": ("line", "SimpleLine"),
    "Polygon": ("fill", "SimpleFill"),
    "MultiPolygon": ("fill", "SimpleFill"),
}


@dataclass(frozen=True, slots=True)
class Symbol:
    """How something is drawn; sizes in millimetres."""

    line: Colour
    width_mm: float
    fill: Colour | None = None
    opaque: int = 255
    """Of the fill, 0 to 255."""
    dashed: bool = False
    size_mm: float = 1.0


def qml(layer: Layer) -> str:
    """Write the style of a layer for QGIS 3."""
    column, categories = _categories(layer)
    symbols = "".join(_symbol(i, layer, symbol) for i, (*_, symbol) in enumerate(categories))
    kind, attribute, listed = "singleSymbol", "", ""
    if column is not None:
        kind, attribute = "categorizedSymbol", f" attr={quoteattr(column)}"
        listed = "".join(
            f'<category value={quoteattr(value)} label={quoteattr(label)} symbol="{i}" '
            'render="true"/>'
            for i, (value, label, _) in enumerate(categories)
        )
        listed = f"<categories>{listed}</categories>"
    return (
        "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
        '<qgis version="3.22" styleCategories="Symbology">'
        f'<renderer-v2 type="{kind}"{attribute} forceraster="0" symbollevels="0" '
        f'enableorderby="0">{listed}<symbols>{symbols}</symbols></renderer-v2>'
        "<blendMode>0</blendMode><layerOpacity>1</layerOpacity></qgis>\n"
    )


def _categories(layer: Layer) -> tuple[str | None, Sequence[tuple[str, str, Symbol]]]:
    """Return the column by which a layer is drawn (None: one symbol for all), values and labels."""
    match layer.name:
        case "cells":
            there = set(layer.column("state"))
            return "state", [
                (state, palette.STATE_NAMES[state], Symbol(_seam(colour), 0.1, colour, 200))
                for state, colour in palette.STATES.items()
                if state in there
            ]
        case "tracks" | "track_points":
            width_mm, size_mm = (0.4, 1.0) if layer.name == "tracks" else (0.0, 0.8)
            colours = {
                int(str(n)): palette.track_colour(int(str(n))) for n in layer.column("vehicle")
            }
            return "vehicle", [
                (str(n), f"vehicle {n}", Symbol(colour, width_mm, colour, size_mm=size_mm))
                for n, colour in sorted(colours.items())
            ]
        case "fence":
            return "kind", [
                ("fence", "geofence", Symbol(palette.FENCE, 0.4, dashed=True)),
                ("box", "search box", Symbol(palette.BOX, 0.4, dashed=True)),
            ]
    single = {
        "region": Symbol(palette.OUTLINE, 0.7),
        "boundary": Symbol(palette.BOUNDARY, 0.5),
        "frames": Symbol(palette.INK, 0.1, (255, 255, 255), size_mm=1.0),
        "unsearched": Symbol(palette.UNSEARCHED, 0.8),
        "places": Symbol(palette.INK, 0.6, (255, 255, 255), size_mm=3.0),
    }
    return None, [("", layer.title, single[layer.name])]


def _seam(colour: Colour) -> Colour:
    red, green, blue = (round(0.9 * channel + 0.1 * 255) for channel in colour)
    return red, green, blue


def _symbol(number: int, layer: Layer, symbol: Symbol) -> str:
    kind, drawn = _KINDS[layer.geometry]
    options = "".join(
        f'<Option name="{key}" value={quoteattr(value)} type="QString"/>'
        for key, value in _options(drawn, symbol).items()
    )
    return (
        f'<symbol type="{kind}" name="{number}" alpha="1" clip_to_extent="1" force_rhr="0">'
        f'<layer class="{drawn}" enabled="1" locked="0" pass="0"><Option type="Map">{options}'
        "</Option></layer></symbol>"
    )


def _options(drawn: str, symbol: Symbol) -> dict[str, str]:
    line, width = _rgba(symbol.line, 255), f"{symbol.width_mm:g}"
    pen = "dash" if symbol.dashed else "solid"
    fill = _rgba(symbol.fill or (0, 0, 0), symbol.opaque if symbol.fill else 0)
    if drawn == "SimpleLine":
        return {
            "line_color": line, "line_width": width, "line_width_unit": "MM", "line_style": pen,
            "joinstyle": "round", "capstyle": "round",
        }  # fmt: skip
    outline = {
        "color": fill, "outline_color": line, "outline_width": width, "outline_width_unit": "MM",
        "outline_style": pen if symbol.width_mm else "no",
    }  # fmt: skip
    if drawn == "SimpleMarker":
        return {**outline, "name": "circle", "size": f"{symbol.size_mm:g}", "size_unit": "MM"}
    return {**outline, "style": "solid" if symbol.fill else "no", "joinstyle": "miter"}


def _rgba(colour: Colour, opaque: int) -> str:
    return ",".join(map(str, (*colour, opaque)))
