"""The files of all formats, and the documents of a flight: report.html, report.pdf and map.gpkg.

If a document cannot be written, a line reports it; all other results are written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Final, NamedTuple

from missions.errors import OutputError
from uavmap.base.atomic_write import write_bytes
from uavmap.base.extras import install_command
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.formats.map_layers import layers

REPORT: Final = "report.html"
REPORT_PDF: Final = "report.pdf"
"""Name of the report as PDF, which the extra `pdf` writes."""


class Format(NamedTuple):
    """A kind of file: its name, or that of a folder with a file per layer; its encoder's module."""

    name: str
    module: str
    several: bool = False
    beside: bool = False
    """True if it names files beside it, so that it belongs into the folder of the results."""


FORMATS: Final[Mapping[str, Format]] = {
    "gpkg": Format("map.gpkg", "geopackage_layers"),
    "shp": Format("shp", "shapefile_layers", several=True),
    "geojson": Format("geojson", "geojson_encoder", several=True),
    "kml": Format("flight.kml", "kml_encoder"),
    "gpx": Format("flight.gpx", "gpx_layers"),
    "csv": Format("csv", "csv_layers", several=True),
    "kmz": Format("flight.kmz", "kmz_encoder"),
    "stac": Format("stac-item.json", "stac_item", beside=True),
    "wpml": Format("follow-up.kmz", "wpml_encoder"),
    "geopdf": Format("map.pdf", "geopdf_encoder"),
}
GEOPACKAGE: Final = FORMATS["gpkg"].name


def files_of(flown: FlownMission, kind: str, **choices: str) -> dict[str, bytes]:
    """Encode the files of a format, by name; `choices` are the format's own.

    Raises `UavmapError` if a package or a result that the format needs is missing.
    """
    made = FORMATS[kind]
    encode = import_module(f"uavmap.output.formats.{made.module}").encode
    data = encode(flown, layers(flown), **choices)
    return data if isinstance(data, dict) else {made.name: data}


def write_documents(flown: FlownMission, report: Callable[[str], None]) -> None:
    """Write the documents into the folder of the results; report each one that fails."""
    command = f"uavmap report {flown.folder}"
    kinds = [
        (GEOPACKAGE, write_geopackage, f"uavmap export {flown.folder} --to gpkg"),
        (REPORT, write_report, command),
    ]
    if prints_pdf():
        kinds.append((REPORT_PDF, write_pdf, command))
    for name, write, again in kinds:
        try:
            write(flown)
        except OutputError as error:
            report(f"{error}; all other results are complete; `{again}` writes it again")
        except Exception as error:  # a fault in a document must not cost the other results
            report(
                f"{name} is not written ({type(error).__name__}: {error}), which is a defect of "
                "the program; all other results are complete"
            )


def write_geopackage(flown: FlownMission) -> None:
    """Write map.gpkg. Raises `OutputError`."""
    path = flown.folder / GEOPACKAGE
    require_closed(path)
    save(path, files_of(flown, "gpkg")[GEOPACKAGE])


def write_report(flown: FlownMission, path: Path | None = None) -> None:
    """Write report.html, or another file. Raises `OutputError`."""
    from uavmap.output.report.page import encode  # noqa: PLC0415 - jinja2, where a page is made

    save(path or flown.folder / REPORT, encode(flown))


def prints_pdf() -> bool:
    """Return whether the extra `pdf` is installed."""
    try:
        return find_spec("reportlab") is not None
    except ValueError:  # a test hides the package
        return False


def write_pdf(flown: FlownMission, path: Path | None = None) -> None:
    """Write report.pdf, or another file. Raises `OutputError`, also without the extra `pdf`."""
    path = path or flown.folder / REPORT_PDF
    if not prints_pdf():
        raise OutputError(f"{path}: a PDF needs reportlab: {install_command('pdf')}")
    from uavmap.output.report.two_pages import encode  # noqa: PLC0415 - an extra

    save(path, encode(flown))


def require_closed(path: Path) -> None:
    """Raise `OutputError` if a program has a GeoPackage open: its log would change a new file."""
    for suffix in ("-wal", "-journal"):
        log = path.with_name(f"{path.name}{suffix}")
        if log.exists():
            raise OutputError(
                f"{path}: another program has it open ({log.name}); close it there, or, if no "
                "program has it open, delete that file"
            )


def save(path: Path, data: bytes) -> None:
    """Write a file whole or not at all. Raises `OutputError`."""
    try:
        write_bytes(path, data)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from None
