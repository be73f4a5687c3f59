"""What people open: report.html and map.gpkg, once all other results are on the disk.

Whatever goes wrong with them is told in a line: without them the results are complete.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from PIL import Image

from missions.errors import OutputError
from missions.events import Event
from missions.flight.setting import Setting
from uavmap.base.atomic_write import write_bytes
from uavmap.journal.flight_plan import FlightPlan
from uavmap.output.facts.calendar import Calendar
from uavmap.output.facts.flight_log import FlightLog
from uavmap.output.facts.flown_mission import Flown
from uavmap.output.facts.map_model import MapData
from uavmap.output.formats.exports import FORMATS, files_of

GEOPACKAGE: Final = FORMATS["gpkg"].name
REPORT: Final = "report.html"


def write_documents(flown: Flown, say: Callable[[str], None]) -> None:
    """Write both into the folder of the results; one that cannot be is told."""
    kinds = (
        (GEOPACKAGE, write_geopackage, f"uavmap export {flown.folder} --to gpkg"),
        (REPORT, write_report, f"uavmap report {flown.folder}"),
    )
    for name, write, again in kinds:
        try:
            write(flown)
        except OutputError as error:
            say(f"{error}; all other results are complete, and `{again}` makes it anew")
        except Exception as error:  # a map is worth more than a page about it
            say(
                f"{name} is not written ({type(error).__name__}: {error}), which is a defect of "
                "the program; all other results are complete"
            )


def load() -> None:
    """Load what documents and pictures are written with: a tenth of a second, the first time, which
    is nobody's while other work is going on."""
    from uavmap.output.report.page import load as load_page  # noqa: PLC0415 - see write_report

    Image.preinit()
    load_page()


def with_documents(
    folder: Path,
    plan: FlightPlan,
    setting: Setting,
    events: Sequence[Event],
    say: Callable[[str], None],
) -> tuple[Calendar, Callable[[MapData, Mapping[str, Any]], None]]:
    """When a flight was, and what writes the documents of its map and its summary."""
    calendar = Calendar.of_flight(plan)

    def write(data: MapData, values: Mapping[str, Any]) -> None:
        log = FlightLog.of(events)
        write_documents(Flown(folder, plan, setting, data, values, log, calendar), say)

    return calendar, write


def write_geopackage(flown: Flown) -> None:
    """map.gpkg. Raises `OutputError`."""
    path = flown.folder / GEOPACKAGE
    refuse_open(path)
    _write(path, files_of(flown, "gpkg")[GEOPACKAGE])


def write_report(flown: Flown, path: Path | None = None) -> None:
    """report.html, or another file. Raises `OutputError`."""
    from uavmap.output.report.page import encode  # noqa: PLC0415 - jinja2, where a page is made

    _write(path or flown.folder / REPORT, encode(flown))


def refuse_open(path: Path) -> None:
    """Raise `OutputError` where a GeoPackage is open in another program.

    Its log lies beside it then, and would be taken for that of the file that replaces it.
    """
    for suffix in ("-wal", "-journal"):
        log = path.with_name(f"{path.name}{suffix}")
        if log.exists():
            raise OutputError(
                f"{path}: is open in another program ({log.name}); close it there, or, if it is "
                "nowhere open, delete that file"
            )


def _write(path: Path, data: bytes) -> None:
    try:
        write_bytes(path, data)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from None
