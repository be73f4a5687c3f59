"""Pages without a script, that load nothing: report.html, and a plan. All texts are escaped."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template, select_autoescape

from uavmap.base.printable import printable
from uavmap.base.version import __version__
from uavmap.output.drawing import svg
from uavmap.output.drawing.scene import Scene
from uavmap.output.facts.flown_mission import Flown
from uavmap.output.report import facts
from uavmap.output.report.drawings import (
    boundary_frames,
    draw_map,
    draw_timeline,
    legend_of,
    minutes,
)


def encode(flown: Flown) -> bytes:
    """Write the page."""
    return _template("page.html").render(_context(flown)).encode(errors="xmlcharrefreplace")


def encode_plan(
    scene: Scene, plan_facts: Sequence[tuple[str, str]], warnings: Sequence[str]
) -> bytes:
    """Write the plan of a mission as a page."""
    drawing = svg.map_drawing(scene)
    told = {"scene": scene, "drawing": drawing, "legend": legend_of(scene), "facts": plan_facts}
    return _template("plan.html").render(told, warnings=warnings).encode()


@lru_cache
def _template(name: str) -> Template:
    # escape in every case, also where a template does not end in .html
    environment = Environment(
        loader=PackageLoader("uavmap.output.report", ""),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["printable"] = printable
    return environment.get_template(name)


def _context(flown: Flown) -> dict[str, Any]:
    return {
        "flown": flown,
        "facts": facts,
        "data": flown.data,
        "mission": flown.setting.mission,
        "finding": str(flown.values.get("finding", "")),
        "map": draw_map(flown),
        "timeline": draw_timeline(flown),
        "frames": boundary_frames(flown),
        "minutes": minutes,
        "written_by": __version__,
    }
