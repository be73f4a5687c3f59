"""Pages without scripts or external files: report.html, and a plan. All texts are escaped."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined, Template, select_autoescape
from markupsafe import Markup

from uavmap.base.printable import printable
from uavmap.base.version import __version__
from uavmap.output.drawing import svg
from uavmap.output.drawing.judged import FILE as JUDGED
from uavmap.output.drawing.mosaic_file import Ground
from uavmap.output.drawing.scene import Scene
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.report import facts, words
from uavmap.output.report.map_figure import CORNER_HEADS, MapFigure, map_figure
from uavmap.output.report.pictures import address, boundary_frames
from uavmap.output.report.timeline import timeline

_JUDGED_PX: Final = 640
_TIMELINE_PX: Final = (600.0, 52.0)
"""Width of the timeline, and height of a vehicle in it, px, for phones as well."""
_MAX_ROWS: Final = 100


def encode(flown: FlownMission) -> bytes:
    """Write the page."""
    return _template("page.html").render(_context(flown)).encode(errors="xmlcharrefreplace")


def encode_plan(
    scene: Scene, plan_facts: Sequence[tuple[str, str]], warnings: Sequence[str]
) -> bytes:
    """Write the plan of a mission as a page."""
    drawing = svg.map_drawing(scene)
    values = {"scene": scene, "drawing": drawing, "legend": legend_of(scene), "facts": plan_facts}
    return _template("plan.html").render(values, warnings=warnings).encode()


def legend_of(scene: Scene) -> tuple[tuple[Markup, str], ...]:
    """Return the samples of a legend with their texts."""
    return tuple((svg.sample(entry), entry.text) for entry in scene.legend)


@lru_cache
def _template(name: str) -> Template:
    # escape texts in all templates, also without the ending .html
    environment = Environment(
        loader=PackageLoader("uavmap.output.report", ""),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["printable"] = printable
    return environment.get_template(name)


def _context(flown: FlownMission) -> dict[str, Any]:
    figure = map_figure(flown)
    drawn = timeline(flown, *_TIMELINE_PX, most=_MAX_ROWS)
    return {
        "flown": flown,
        "facts": facts,
        "words": words,
        "data": flown.data,
        "mission": flown.setting.mission,
        "finding": str(flown.values.get("finding", "")),
        "figure": figure,
        "map": _map(flown, figure),
        "legend": legend_of(figure.scene),
        "corner_heads": CORNER_HEADS,
        "corners": [corner.row() for corner in figure.corners],
        "timeline": drawn and svg.document(drawn.view, drawn.shapes, "timeline"),
        "frames": boundary_frames(flown),
        "judged": address(flown.folder / JUDGED, _JUDGED_PX),
        "written_by": __version__,
    }


def _map(flown: FlownMission, figure: MapFigure) -> Markup:
    ground = Ground.read(flown.folder, flown.data.grid)
    photograph = None if ground is None else ground.beneath(figure.scene.view)
    return svg.map_drawing(figure.scene, figure.lines, figure.labels, photograph)
