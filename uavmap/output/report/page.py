"""report.html: a page without a script, that loads nothing; what comes from outside is escaped."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined, Template, select_autoescape

from uavmap.base.printable import printable
from uavmap.base.version import __version__
from uavmap.output.facts.flown_mission import Flown
from uavmap.output.report import facts
from uavmap.output.report.kept_pictures import boundary_frames
from uavmap.output.report.map_drawing import draw_map
from uavmap.output.report.timeline import draw_timeline, minutes

_TEMPLATE: Final = "page.html"


def encode(flown: Flown) -> bytes:
    """Write the page."""
    return _template().render(_context(flown)).encode(errors="xmlcharrefreplace")


def load() -> None:
    """Compile the template, which takes a while."""
    _template()


@lru_cache(maxsize=1)
def _template() -> Template:
    # escape in every case, also where a template does not end in .html
    environment = Environment(
        loader=PackageLoader("uavmap.output.report", ""),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(_TEMPLATE)


def _context(flown: Flown) -> dict[str, Any]:
    judged, missing = facts.certificate(flown)
    patches, more_patches = facts.patch_rows(flown)
    troubles, more = facts.trouble_rows(flown)
    calendar, data = flown.calendar, flown.data
    mission = flown.setting.mission
    return {
        "mission": printable(data.mission),
        "finding": printable(str(flown.values.get("finding", ""))),
        "completed": flown.completed,
        "recorded": flown.recorded,
        "simulated": flown.simulated,
        "begun": calendar.told(0.0),
        "ended": calendar.told(data.t_s),
        "lasted": minutes(data.t_s),
        "crs": flown.crs,
        "zone": f"{data.grid.zone.number}{'S' if data.grid.zone.south else 'N'}",
        "drift_m_s": data.grid.drift_speed_m_s,
        "map": draw_map(flown),
        "extent": facts.extent_facts(flown),
        "judged": judged,
        "missing": missing,
        "patches": patches,
        "more_patches": more_patches,
        "box": facts.box_told(flown),
        "truth": facts.truth_facts(flown),
        "flight": facts.flight_facts(flown),
        "timeline": draw_timeline(flown),
        "sorties": facts.sortie_rows(flown),
        "troubles": troubles,
        "more_troubles": more,
        "notes": facts.notes(flown),
        "frames": boundary_frames(flown),
        "calendar": calendar,
        "settings": facts.settings(flown),
        "strategy": mission.strategy,
        "vehicles": len(mission.vehicles),
        "seed": flown.plan.seed if flown.simulated else None,
        "driver": flown.plan.driver,
        "flown_by": printable(flown.plan.version),
        "written_by": __version__,
    }
