"""The results of a flight or a replay as geometries, tables and pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon, shape
from shapely.geometry.base import BaseGeometry

from missions.errors import ResultsError, UavmapError
from missions.geo.geodesy import UtmZone
from missions.units import LatLon
from uavmap.base.arguments import Paths, path_text
from uavmap.base.extras import install_command
from uavmap.base.text_files import read_text
from uavmap.journal.flight_plan import JOURNAL
from uavmap.output.drawing import palette

if TYPE_CHECKING:
    import geopandas
    from matplotlib.axes import Axes

WGS84: Final = "EPSG:4326"
_MAP, _SUMMARY, _BOUNDARY, _PICTURE = "map.geojson", "summary.json", "boundary.geojson", "map.png"
_LARGEST_BYTES: Final = 1_000_000_000
_POINTS_A_PIXEL: Final = 0.65
_COLUMNS: Final = ("column", "row", "state", "positive", "votes", "belief")


def open_results(folder: Paths) -> Results:
    """Open the results of a flight or a replay.

    Raises:
        ResultsError: The folder has no map, as after an interrupt, or damaged files.

    Examples:
        >>> open_results("no-such-folder")
        Traceback (most recent call last):
        missions.errors.ResultsError: no-such-folder: no such folder; give a results folder
    """
    where = Path(path_text("folder", folder))
    if not where.is_dir():
        raise ResultsError(f"{where}: no such folder; give a results folder")
    if not (where / _MAP).exists():
        how = f"; to continue: uavmap resume {where}" if (where / JOURNAL).exists() else ""
        raise ResultsError(f"{where}: has no {_MAP}: the mission has not ended{how}")
    return Results(where, _object(where / _SUMMARY), _features(where / _MAP))


class Results:
    """A results folder, as it was when opened: `map.geojson`, `summary.json` and the rest.

    `uavmap.fly`, `uavmap.replay` and `uavmap.open_results` return it. Geometries are shapely's, in
    longitude and latitude (WGS84, EPSG:4326). Those with `_utm` are in metres of the UTM zone
    `utm_crs`, with which the grid is aligned.

    Attributes:
        folder: The path of the folder.
        summary: The figures of `summary.json`, by name; see the page on file formats.
    """

    def __init__(
        self, folder: Path, summary: dict[str, Any], features: list[dict[str, Any]]
    ) -> None:
        self.folder = folder
        self.summary = summary
        self._features = features

    def __repr__(self) -> str:
        return f"<Results in {self.folder}: {self.summary.get('finding', '')}>"

    def _repr_png_(self) -> bytes | None:
        path = self.folder / _PICTURE
        return path.read_bytes() if path.exists() else None

    # --- figures ---------------------------------------------------------------------------------
    @property
    def completed(self) -> bool:
        """True if the mission is complete; for a replay, if most pictures are in the map."""
        return bool(self.summary["completed"])

    @property
    def finding(self) -> str:
        """The finding in a sentence, restricted to the ground that was judged."""
        return str(self.summary["finding"])

    @property
    def no_verdict(self) -> str | None:
        """The reason if the detector does not fit the ground, so that the map shows nothing."""
        return self.summary.get("no_verdict")

    @property
    def aircraft_down(self) -> tuple[str, ...]:
        """A line with the place of each aircraft that the crew has to fetch."""
        return tuple(self.summary.get("aircraft_down", ()))

    @property
    def area_m2(self) -> float:
        """The area of the region's cells on the ground, m²; 0 without a region."""
        (outline,) = self.features("outline")
        return float(outline["properties"]["area_m2"])

    # --- geometries ------------------------------------------------------------------------------
    @property
    def region(self) -> BaseGeometry:
        """The outline of the region's cells with its holes, in longitude and latitude.

        A `Polygon` or `MultiPolygon`, empty without a region. A drifting region is where it was at
        the end of the map.
        """
        (outline,) = self.features("outline")
        region: BaseGeometry = _shape(outline)
        return region

    @property
    def region_utm(self) -> BaseGeometry:
        """The outline of the region's cells in metres of `utm_crs`."""
        return self.to_utm(self.region)

    @cached_property
    def boundary(self) -> BaseGeometry | None:
        """The region at pixel level, in longitude and latitude; None without kept pictures."""
        path = self.folder / _BOUNDARY
        if not path.exists():
            return None
        found = (f for f in _features(path) if f["properties"].get("kind") == "boundary")
        return shapely.union_all([_shape(feature) for feature in found])

    @property
    def tracks(self) -> dict[int, LineString]:
        """The track of each vehicle, by its number: longitude, latitude, metres above home.

        A replay has the places of the pictures as the track of vehicle 1.
        """
        return {f["properties"]["vehicle"]: _shape(f) for f in self.features("track")}

    @cached_property
    def utm_crs(self) -> str:
        """The UTM zone of the map, such as `"EPSG:32617"`: the zone at the start of the first
        track."""
        return f"EPSG:{self._zone.epsg}"

    @cached_property
    def _zone(self) -> UtmZone:
        for feature in [*self.features("track"), *self.features("cell"), *self.features("outline")]:
            for lon, lat, *_ in shapely.get_coordinates(_shape(feature)).tolist():
                return UtmZone.containing(LatLon(lat, (lon + 180.0) % 360.0 - 180.0))
        raise ResultsError(f"{self.folder / _MAP}: no feature has a place")

    def to_utm(self, geometry: BaseGeometry) -> BaseGeometry:
        """Transform longitudes and latitudes to metres of `utm_crs`; heights are dropped.

        Lengths in the projection are up to 0.04 % shorter than on the ground.
        """
        moved: BaseGeometry = shapely.transform(geometry, self._zone.utm)
        return moved

    # --- tables ----------------------------------------------------------------------------------
    def features(self, kind: str) -> list[dict[str, Any]]:
        """Return features of the map: `"cell"`, `"outline"`, `"track"` or `"unsearched"`."""
        return [f for f in self._features if f["properties"].get("kind") == kind]

    @cached_property
    def cells(self) -> geopandas.GeoDataFrame:
        """All judged cells, as a GeoDataFrame in EPSG:4326 (needs the extra `frames`).

        Columns: `column` and `row` of the grid, `state`, `positive` (votes for region), `votes`,
        `belief` (0 to 1 for recorded pictures; else NaN), and `geometry`.
        `cells.to_crs(results.utm_crs)` has metres. Raises `UavmapError` if geopandas is not
        installed.
        """
        try:
            import geopandas  # noqa: PLC0415 - an extra, and heavy
        except ImportError:
            raise UavmapError(
                f"cells as a table need geopandas: {install_command('frames')}"
            ) from None
        rows = self.features("cell")
        table = {name: [row["properties"].get(name) for row in rows] for name in _COLUMNS}
        table["belief"] = [np.nan if value is None else value for value in table["belief"]]
        return geopandas.GeoDataFrame(table, geometry=[_shape(row) for row in rows], crs=WGS84)

    # --- pictures --------------------------------------------------------------------------------
    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw cells, outline and tracks in metres of `utm_crs`, into `ax` or a new figure.

        Raises `UavmapError` if matplotlib is not installed (the extra `study`).
        """
        try:
            from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra, and heavy
            from matplotlib.collections import PolyCollection  # noqa: PLC0415
        except ImportError:
            raise UavmapError(f"a plot needs matplotlib: {install_command('study')}") from None
        if ax is None:
            ax = plt.subplots(figsize=(7.0, 7.0), layout="constrained")[1]
        squares: dict[str, list[Any]] = {}
        for cell in self.features("cell"):
            corners = shapely.get_coordinates(self.to_utm(_shape(cell)))
            squares.setdefault(cell["properties"]["state"], []).append(corners)
        for state, colour in palette.STATES.items():
            if own := squares.get(state):
                cells = PolyCollection(own, facecolor=_rgb(colour), edgecolor="white")
                cells.set(linewidth=0.3, label=f"{palette.STATE_NAMES[state]} ({len(own)})")
                ax.add_collection(cells)
        for region, line in ((self.region, "outline"), (self.boundary, "boundary")):
            if region is not None:
                _plot_lines(ax, shapely.boundary(self.to_utm(region)), *palette.LINES[line])
        for number, track in self.tracks.items():
            label = "track" if len(self.tracks) == 1 else f"track of vehicle {number}"
            _plot_lines(
                ax,
                self.to_utm(track),
                label,
                palette.Style(palette.track_colour(number), palette.TRACK_PX),
            )
        ax.autoscale_view()
        ax.set_aspect("equal")
        ax.ticklabel_format(useOffset=False, style="plain")
        ax.tick_params(labelsize="small")
        ax.set_xlabel(f"easting, m ({self.utm_crs})")
        ax.set_ylabel("northing, m")
        ax.set_title(self.finding, fontsize="small")
        ax.legend(fontsize="small", loc="best")
        return ax


def _plot_lines(ax: Axes, lines: BaseGeometry, label: str, style: palette.Style) -> None:
    width = _POINTS_A_PIXEL * style.width_px
    for part in shapely.get_parts(lines):
        places = shapely.get_coordinates(part)
        ax.plot(places[:, 0], places[:, 1], color=_rgb(style.colour), linewidth=width, label=label)
        label = "_"  # only the first is in the legend


def _rgb(colour: palette.Colour) -> tuple[float, float, float]:
    red, green, blue = (channel / 255.0 for channel in colour)
    return red, green, blue


# --- files ---------------------------------------------------------------------------------------
def _object(path: Path) -> dict[str, Any]:
    """Read the object of a JSON file. Raises `ResultsError`."""
    try:
        found = json.loads(read_text(path, _LARGEST_BYTES))
    except OSError as error:
        raise ResultsError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise ResultsError(f"{path}: is damaged ({error})") from None
    if not isinstance(found, dict):
        raise ResultsError(f"{path}: is damaged (no JSON object)")
    return found


def _features(path: Path) -> list[dict[str, Any]]:
    found = _object(path).get("features")
    good = isinstance(found, list) and all(
        isinstance(one, dict) and isinstance(one.get("properties"), dict) for one in found
    )
    if not good:
        raise ResultsError(f"{path}: is damaged (no features)")
    return list(found or ())


def _shape(feature: Mapping[str, Any]) -> Any:
    """Return the geometry of a feature; empty for a region that was not found."""
    geometry = feature.get("geometry")
    return Polygon() if geometry is None else shape(geometry)
