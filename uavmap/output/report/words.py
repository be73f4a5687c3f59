"""The texts at the top of a report: the outcome, unknown ground, the size of the region."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
import shapely

from missions.units import LatLon
from uavmap.load.detector_source import region_in_words
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.facts.map_model import on_earth
from uavmap.output.report import facts
from uavmap.output.summary import box_in_words, litres_in_words, state_in_words

SIMULATED: Final = "Simulated: aircraft, pictures, region and dates are those of the simulator."


def outcome(flown: FlownMission) -> str:
    """Return the end of a flight or a replay and its meaning for the map, in two sentences."""
    values, region = flown.values, bool(np.count_nonzero(flown.data.cells.roi))
    if flown.recorded:
        return _of_pictures(flown, region)
    if values.get("no_verdict"):
        return f"No verdict: {values['no_verdict']}. The map does not show the region."
    if not flown.completed and not values.get("flown_to_the_end"):
        time = facts.minutes(flown.data.t_s)
        at = f"The flight is not complete: this is the map at mission time {time} min."
        if region:
            return f"{at} The region may be larger, and there may be more of it elsewhere."
        return f"{at} No region is found so far."
    in_all = values["patches_in_all"]
    whole = "The whole search area was seen." if in_all["box"]["whole"] else ""
    unsure = bool(values.get("flown_to_the_end"))
    if not region:
        found = "No region was found" + (", except where ground is unsure." if unsure else ".")
    elif unsure:
        found = "The region is mapped, except where ground is unsure."
    elif not in_all["complete"]:
        found = "The flight is over, and the edge of the region is open in places."
    elif (pieces := len(values["patches"])) == 1:
        found = "The region is mapped to its edge all around."
    else:
        found = f"The region has {pieces} pieces; each is mapped to its edge all around."
    return f"{found} {whole}".rstrip()


def _of_pictures(flown: FlownMission, region: bool) -> str:
    used = flown.data.pictures or 0
    refused = _count(flown, "photographs_refused")
    if not used:
        return f"None of {refused} pictures can be used. There is no map."
    pictures = f"{used} picture{'' if used == 1 else 's'}"
    if flown.ending == "Too few pictures":
        return f"Only {used} of {used + refused} pictures can be used. The map is not reliable."
    found = f"The region is mapped from {pictures}." if region else f"No region is in {pictures}."
    return f"{found} Ground that no picture shows is not judged."


# --- first of all ---------------------------------------------------------------------------------
def unknowns(flown: FlownMission) -> list[str]:
    """Return the lines that a reader needs before any figure: unsure and unseen ground first."""
    return [*_unsure(flown), *_unseen(flown), *_open_edge(flown), *facts.notes(flown)]


def _unsure(flown: FlownMission) -> Iterator[str]:
    area_m2 = facts.number(flown.values, "cells_unsure_m2")
    if area_m2:
        yield (
            f"Unsure ground: {area(area_m2)} are unlike what the detector knows. They may belong "
            "to the region; its area does not contain them."
        )


def _unseen(flown: FlownMission) -> Iterator[str]:
    cell_m2 = flown.data.grid.cell_m**2
    if flown.recorded:
        if cells := _count(flown, "cells_undecided"):
            yield (
                f"Unseen ground: {area(cells * cell_m2)} are in too few pictures to be judged. "
                "They may belong to the region."
            )
        return
    box = flown.values["patches_in_all"]["box"]
    if box["whole"]:
        return
    left = box["few_frames"] + box["no_frames"]
    kinds = ((box["no_frames"], "in no picture"), (box["few_frames"], "in too few pictures"))
    which = " and ".join(f"{_cells(count)} {where}" for count, where in kinds if count)
    yield (
        f"Unseen ground: {area(left * cell_m2)} of the search area ({_share(left, box['cells'])}) "
        f"have no verdict: {which}. A piece of the region may be missing there."
    )


def _open_edge(flown: FlownMission) -> Iterator[str]:
    boundary = flown.boundary
    if boundary is not None and boundary.open_m:
        yield (
            f"The region may go on: {boundary.open_m:,.0f} m of its boundary run along the end of "
            "the pictures."
        )
        return
    count, text = flown.extent.open_cells, ""
    if not flown.recorded and (in_all := flown.values["patches_in_all"])["open"]:
        text = f": its edge is {state_in_words(in_all)}."
    elif count:
        text = f" at {_cells(count)} of its edge, beside ground without a verdict."
    if text:
        yield f"The region may go on{text}"


def _count(flown: FlownMission, key: str) -> int:
    return int(facts.number(flown.values, key) or 0)


def _cells(count: int) -> str:
    return "1 cell" if count == 1 else f"{count:,} cells"


def _share(part: int, whole: int) -> str:
    """Write a share in per cent.

    >>> _share(1, 3), _share(1, 13870)
    ('33 %', 'less than 1 %')
    """
    share = part / max(whole, 1)
    return f"{share:.0%}".replace("%", " %") if share >= 0.01 else "less than 1 %"


# --- how large, and where -------------------------------------------------------------------------
def area(area_m2: float) -> str:
    """Write an area in both units.

    >>> area(2160.0), area(3_456_789.0)
    ('2,160 m² (0.216 ha)', '3,456,789 m² (346 ha)')
    """
    return f"{area_m2:,.0f} m² ({hectares(area_m2)} ha)"


def hectares(area_m2: float) -> str:
    """Write an area in hectares, to three digits or to 10 m².

    >>> hectares(96.0), hectares(54_321.0)
    ('0.010', '5.43')
    """
    value = area_m2 / 1e4
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.{3 if value < 1.0 else 2}f}"


class Size(NamedTuple):
    """The area of the region with its limits, in words."""

    area: str
    between: str
    how: str


def size(flown: FlownMission) -> Size | None:
    """Return the size of the region, by pixels if its boundary is known; None without a region."""
    boundary, found = flown.boundary, flown.extent
    cell_m = flown.data.grid.cell_m
    if boundary is not None and not boundary.region.is_empty:
        by_cells = f"by whole cells of {cell_m:g} m it is {found.area_m2:,.0f} m²"
        low_m2, high_m2, how = boundary.low_m2, boundary.high_m2, f"by its boundary; {by_cells}"
        area_m2 = boundary.area_m2
    elif not found.outline.is_empty:
        area_m2, low_m2, high_m2 = found.area_m2, found.low_m2, found.high_m2
        pieces = "1 piece" if found.parts == 1 else f"{found.parts} pieces"
        count = np.count_nonzero(flown.data.cells.roi)
        how = f"{count:,} cells of {cell_m:g} m, {pieces}"
    else:
        return None
    between = (
        f"between {low_m2:,.0f} and {high_m2:,.0f} m² "
        f"({hectares(low_m2)} to {hectares(high_m2)} ha)"
    )
    return Size(area(area_m2), between, how)


class NamedPlace(NamedTuple):
    """A place in both coordinate systems."""

    name: str
    degrees: str
    utm: str
    link: str


def middle_place(flown: FlownMission) -> NamedPlace:
    """Return the middle of the region; without one, that of the map's cells, or the home."""
    grid, outline = flown.data.grid, flown.extent.outline
    if outline.is_empty:
        return _named_place(flown, "Home", flown.data.start)
    middle = shapely.get_coordinates(outline.centroid)
    ((lon, lat),) = on_earth(middle, grid, flown.data.t_s).tolist()
    return _named_place(flown, "Middle of the region", LatLon(lat, lon))


def _named_place(flown: FlownMission, name: str, at: LatLon) -> NamedPlace:
    zone = flown.data.grid.zone
    ((east, north),) = zone.utm(np.array([[at.lon_deg, at.lat_deg]])).tolist()
    lon_deg = (at.lon_deg + 180.0) % 360.0 - 180.0
    degrees = (
        f"{abs(at.lat_deg):.5f}° {'NS'[at.lat_deg < 0]}, {abs(lon_deg):.5f}° {'EW'[lon_deg < 0]}"
    )
    here = f"mlat={at.lat_deg:.5f}&mlon={lon_deg:.5f}"
    link = f"https://www.openstreetmap.org/?{here}#map=17"
    utm = f"{zone.number}{'S' if zone.south else 'N'} {east:,.0f} m E, {north:,.0f} m N"
    return NamedPlace(name, degrees, utm, link)


def dates(flown: FlownMission) -> list[tuple[str, str]]:
    """Return the dates of the beginning and of the map."""
    calendar, t_s = flown.calendar, flown.data.t_s
    if flown.recorded:
        return [
            ("First picture", calendar.in_words(0.0)),
            ("Last picture", calendar.in_words(t_s)),
        ]
    return [
        ("Begun", calendar.in_words(0.0)),
        ("Map of", f"{calendar.in_words(t_s)}, mission time {facts.minutes(t_s)} min"),
    ]


def reference(flown: FlownMission) -> str:
    """Return the coordinate reference systems."""
    zone = flown.data.grid.zone
    name = f"{zone.number}{'S' if zone.south else 'N'}"
    return f"WGS 84 in degrees; grid in {flown.crs}, WGS 84 / UTM zone {name}"


def map_note(flown: FlownMission, true_north_deg: float) -> str:
    """Return the note below the map."""
    drift_m_s = flown.data.grid.drift_speed_m_s
    side = "left" if true_north_deg < 0 else "right"
    note = (
        f"{flown.calendar.in_words(flown.data.t_s)}. Up is grid north; true north is "
        f"{abs(true_north_deg):.2f}° to the {side}."
    )
    if not drift_m_s:
        return note
    return (
        f"{note} The region drifts with {drift_m_s:g} m/s: the map shows its place at that time, "
        "and tracks in the frame of the region."
    )


# --- how ------------------------------------------------------------------------------------------
TIMELINE: Final = (
    "Bars are sorties; a pale bar has no known landing. Circles are fresh batteries, triangles are "
    "faults. The line below is the charge, the dashed line is the reserve."
)
JUDGED: Final = (
    "Outlined in red: the region by the detector, in the first picture that shows some of it, or "
    "else in the first picture."
)
_JUDGED: Final = ("Cells decided",)
_EDGE: Final = ("Boundary by pixels", "Perimeter by cells", "Parts, holes", "Position")


def class_lines(flown: FlownMission) -> Iterator[str]:
    """Yield a sentence per class of the region."""
    for one in flown.data.class_areas:
        litres = litres_in_words(one.volume_l)
        yield (
            f"{one.name}: {one.area_m2:,.0f} m² ({one.low_m2:,.0f} to {one.high_m2:,.0f})"
            + f", {litres}" * bool(litres)
        )


def detector(flown: FlownMission) -> str:
    """Return the definition of region by the detector."""
    return f"Region is: {region_in_words(flown.setting.mission.detector)}."


def pictures(flown: FlownMission) -> list[tuple[str, str]]:
    """Return the number of pictures in the map, and their heights."""
    if not flown.recorded:
        return [("Pictures judged", f"{_count(flown, 'frames_judged'):,}")]
    used, refused = flown.data.pictures or 0, _count(flown, "photographs_refused")
    why = "; pictures.csv has the reasons for the others" if refused else ""
    heights_m = [height for track in flown.data.tracks for _, _, height in track.points]
    found = [("Pictures in the map", f"{used:,} of {used + refused:,}{why}")]
    if heights_m:
        low, high = f"{min(heights_m):.0f}", f"{max(heights_m):.0f}"
        height = f"{low} m" if low == high else f"{low} to {high} m"
        found.append(("Taken from", f"{height} above the start"))
    return found


def judged(flown: FlownMission) -> list[tuple[str, str]]:
    """Return the judged ground, and the accuracy of the region's edge."""
    found = [row for row in facts.certificate(flown)[0] if row[0] in _JUDGED]
    if not flown.recorded and (box := flown.values["patches_in_all"]["box"])["whole"]:
        found.append(("Search area", box_in_words(box)))
    if not flown.extent.outline.is_empty:
        found += [row for row in facts.extent_facts(flown) if row[0] in _EDGE]
    return found


def left_undone(flown: FlownMission, most: int) -> list[str]:
    """Return work that was not done, with reasons, then the faults; at most `most` lines."""
    _, missing = facts.certificate(flown)
    found = [f"{name}: {why}." for name, why in missing]
    if not flown.recorded and not (box := flown.values["patches_in_all"]["box"])["whole"]:
        found.insert(0, f"Search area: {box_in_words(box)}.")
    troubles, more = facts.trouble_rows(flown)
    found += [" ".join(filter(None, map(str, row))) for row in troubles]
    if not found:
        return ["Nothing is known to be missing, and no fault is known."]
    left = len(found) - most + more
    return found if left <= 0 else [*found[:most], f"{left} more in report.html."]
