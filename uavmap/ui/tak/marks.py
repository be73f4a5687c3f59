"""The live map as marks of Cursor on Target (CoT): aircraft, areas, lines. Pure but for a clock.

Aircraft of others have the UIDs of ADS-B gateways for TAK, as adsbcot: `ICAO-3C6444`. So one that
several sources report is one object on the map.

Shapes are those of ATAK: type `u-d-f` with a `link` for each point; a ring ends with its first
point. CoT has no holes: a hole is a separate ring, and an area with a hole is not filled.
"""

from __future__ import annotations

import math
import re
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree as ET

import shapely
from shapely.geometry import LineString, MultiPolygon, Polygon

from uavmap.base.printable import printable
from uavmap.output.drawing import palette
from uavmap.output.drawing.palette import Colour
from uavmap.ui.page.live_map import Aircraft, LiveMap

AIRCRAFT: Final = "a-f-A-M-H-Q"
"""Type of a friendly aircraft: military symbol, rotary wing, unmanned."""
UNIT: Final = "a-f-G-U-C-V-U"
"""Type of a friendly unit on the ground that flies unmanned aircraft."""
OTHER: Final = "a-n-A-C"
"""Type of a neutral aircraft, civil: one of others that broadcasts by ADS-B."""
OTHER_DRONE: Final = "a-n-A-M-F-Q"
"""Type of a neutral unmanned aircraft; TAK has no symbol for a civil one."""
SHAPE: Final = "u-d-f"
DELETES: Final = "t-x-d-d"
AIRCRAFT_STALE_S: Final = 15
"""Time after which the place of an aircraft is out of date, s."""
OTHER_STALE_S: Final = 30
"""Time after which the place of an aircraft of others is out of date, s."""
LANDED_STALE_S: Final = 60
"""Time for which a landed aircraft is shown after the flight, s."""
AREA_STALE_S: Final = 24 * 3600
"""Time for which region and unsure ground are shown, s."""
LINE_STALE_S: Final = 300
"""Time after which a track, a path or the unit is out of date, s; it is sent again before."""
MAX_RINGS: Final = 40
"""Maximum number of rings of an area; the largest are sent."""
MAX_POINTS: Final = 200
"""Maximum number of points: a ring is simplified, and of a line the end is sent."""
TRACK_M: Final = 1.0
"""Maximum distance of a track from its simplified line, m."""
SLOW_M_S: Final = 0.5
"""Speed below which the last course is kept, m/s."""
GAP_S: Final = 5.0
"""Maximum time between two fixes from which a speed is computed, s."""
_ICAO: Final = re.compile(r"[0-9A-F]{6}(?= |$)")
_SOLID, _DOTTED, _DASHED = "solid", "dotted", "dashed"


@dataclass(frozen=True, slots=True)
class Mark:
    """One object on a map of TAK.

    Attributes:
        how: The origin of its place, as a code of CoT.
        detail: The element `detail`, XML.
        repeats: True if it is sent again at times without a change.
        ours: True if it is deleted when it is gone. An aircraft of others only goes out of date,
            since other sources may report it.
        fix_utc_s: Time at which its place was received; None for the time of sending.
    """

    uid: str
    cot_type: str
    lat_deg: float
    lon_deg: float
    how: str
    stale_s: int
    detail: bytes
    repeats: bool = True
    ours: bool = True
    fix_utc_s: float | None = None

    def deleted(self) -> Mark:
        """Return the mark that removes this one."""
        detail = ET.Element("detail")
        ET.SubElement(detail, "link", uid=self.uid, relation="p-p", type="none")
        ET.SubElement(detail, "__forcedelete")
        identity, place = f"{self.uid}-delete", (self.lat_deg, self.lon_deg)
        return Mark(identity, DELETES, *place, self.how, LANDED_STALE_S, ET.tostring(detail))


class Marks:
    """The source of the marks of one mission; their UIDs depend only on its name and start."""

    def __init__(self, *, simulated: bool, utc_s: Callable[[], float] = time.time) -> None:
        self._simulated = simulated
        self._utc_s = utc_s
        self._moved: dict[int, tuple[float, float, float]] = {}
        """Mission time and place of each vehicle's last fix."""
        self._received_utc_s: dict[int, float] = {}
        """Time at which each vehicle's last fix was received."""
        self._motion: dict[int, tuple[float, float]] = {}
        """Course, degrees, and speed, m/s, of each vehicle."""

    def unit(self, live: LiveMap) -> Mark:
        """Return the mark of the sender, at the start of the mission.

        It is sent first: FreeTAKServer identifies its client with the first event of a connection,
        and deletes that mark when the connection ends.
        """
        detail, place = self._detail(live.mission, ["uavmap"]), live.start
        return Mark(
            _uid(live, "unit"), UNIT, place.lat_deg, _turned(place.lon_deg), self._how("m-p"),
            LINE_STALE_S, ET.tostring(detail),
        )  # fmt: skip

    def _how(self, how: str) -> str:
        return "m-s" if self._simulated else how

    # --- aircraft --------------------------------------------------------------------------
    def aircraft(self, live: LiveMap, ended: str | None = None) -> Iterator[Mark]:
        """Yield the aircraft that have answered; `ended` is the reason for the end."""
        for one in live.aircraft():
            record, remarks = one.record, [str(one.record["doing"])]
            if record["phase"] == "offline" and not record["at_s"]:
                continue  # its place is from the mission file
            self._move(one, live)
            stale_s = AIRCRAFT_STALE_S
            if ended is not None:
                remarks = [f"landed; {ended}" if record["landed"] else f"last known place; {ended}"]
                stale_s = LANDED_STALE_S if record["landed"] else AIRCRAFT_STALE_S
            remarks.append(f"{record['up']:.0f} m above home")
            if record["amsl_m"] is not None:
                remarks.append(f"{record['amsl_m']:.0f} m above mean sea level")
            remarks.append(f"battery {record['battery']:.0f} %")
            detail = self._detail(f"{live.mission} {one.number}", remarks)
            if one.number in self._motion and not record["landed"]:
                course_deg, speed_m_s = self._motion[one.number]
                motion = {"course": f"{course_deg:.1f}", "speed": f"{speed_m_s:.1f}"}
                ET.SubElement(detail, "track", motion)
            ET.SubElement(detail, "status", battery=f"{max(record['battery'], 0.0):.0f}")
            ET.SubElement(detail, "precisionlocation", geopointsrc="GPS", altsrc="???")
            place, how = live.place(one), self._how("m-g")
            stands = ended is not None and record["landed"]
            yield Mark(
                _uid(live, f"aircraft-{one.number}"), AIRCRAFT, place.y, _turned(place.x), how,
                stale_s, ET.tostring(detail), repeats=False,
                fix_utc_s=None if stands else self._received_utc_s[one.number],
            )  # fmt: skip

    def _move(self, one: Aircraft, live: LiveMap) -> None:
        at_s = float(one.record["at_s"])
        before = self._moved.get(one.number)
        if before is not None and at_s == before[0]:
            return
        self._moved[one.number] = at_s, one.east_m, one.north_m
        self._received_utc_s[one.number] = self._utc_s()
        if before is None or not 0.0 < at_s - before[0] <= GAP_S:
            self._motion.pop(one.number, None)
            return
        east_m, north_m = one.east_m - before[1], one.north_m - before[2]
        speed_m_s = math.hypot(east_m, north_m) / (at_s - before[0])
        course_deg = math.degrees(math.atan2(east_m, north_m) + live.grid.convergence_rad) % 360.0
        if speed_m_s < SLOW_M_S:
            course_deg = self._motion.get(one.number, (course_deg, 0.0))[0]
        self._motion[one.number] = course_deg, speed_m_s

    def traffic(self, live: LiveMap) -> Iterator[Mark]:
        """Yield the aircraft of others."""
        for place, record in live.traffic():
            detail = self._detail(record["name"], [record["words"], f"received by {live.mission}"])
            if record["speed_m_s"] is not None:
                motion = {"course": record["toward_deg"], "speed": record["speed_m_s"]}
                ET.SubElement(detail, "track", {name: f"{at:.1f}" for name, at in motion.items()})
            found = _ICAO.match(record["ident"])
            uid = f"ICAO-{found[0]}" if found else f"uavmap-traffic-{record['ident']}"
            yield Mark(
                f"SIM-{uid}" if self._simulated else uid, OTHER if found else OTHER_DRONE, place.y,
                _turned(place.x), self._how("m-g"), OTHER_STALE_S, ET.tostring(detail),
                repeats=False, ours=False,
            )  # fmt: skip

    # --- shapes ----------------------------------------------------------------------------
    def shapes(self, live: LiveMap) -> Iterator[Mark]:
        """Yield region, unsure ground, tracks and paths."""
        phase = str(live.snapshot["fields"].get("phase", ""))
        region, unsure = palette.STATES["explored"], palette.STATES["unsure"]
        yield from self._area(live, "region", live.region, (palette.OUTLINE, region), phase)
        yield from self._area(live, "unsure", live.unsure, (unsure, unsure), phase)
        for number, line in live.tracks():
            yield self._line(live, "track", number, line, _SOLID)
        for number, line in live.paths():
            yield self._line(live, "path", number, line, _DOTTED)

    def _area(
        self,
        live: LiveMap,
        kind: str,
        area: Polygon | MultiPolygon,
        colours: tuple[Colour, Colour],
        phase: str,
    ) -> Iterator[Mark]:
        parts = sorted(shapely.get_parts(area).tolist(), key=lambda part: -part.area)
        parts = [part for part in parts if not part.is_empty]
        rings = [(part.exterior, f"{kind}-{k}", part) for k, part in enumerate(parts, 1)]
        for k, part in enumerate(parts, 1):
            holes = sorted(part.interiors, key=lambda hole: -Polygon(hole).area)
            rings += [(hole, f"{kind}-{k}-hole-{j}", None) for j, hole in enumerate(holes, 1)]
        rings.sort(key=lambda ring: -Polygon(ring[0]).area)
        words = [f"{area.area:.0f} m² in all", phase]
        if len(rings) > MAX_RINGS:
            words.append(f"the {MAX_RINGS} largest of {len(rings)} rings")
        for ring, name, part in rings[:MAX_RINGS]:
            about = [f"{part.area:.0f} m²" if part is not None else f"no {kind} inside", *words]
            detail = self._detail(f"{live.mission} {name}", about)
            style = _SOLID if part is not None else _DASHED
            filled = part is not None and not part.interiors
            _draw(detail, colours[0], style, colours[1] if filled else None)
            yield self._shape(live, name, ring, detail, AREA_STALE_S)

    def _line(self, live: LiveMap, kind: str, number: int, line: LineString, style: str) -> Mark:
        detail = self._detail(f"{live.mission} {number} {kind}", [])
        _draw(detail, palette.track_colour(number), style, None)
        newest = LineString(_simpler(line, TRACK_M).coords[-MAX_POINTS:])
        return self._shape(live, f"{kind}-{number}", newest, detail, LINE_STALE_S)

    def _shape(
        self, live: LiveMap, name: str, line: LineString, detail: ET.Element, stale_s: int
    ) -> Mark:
        points = live.on_earth(_thinned(line)).coords
        for lon_deg, lat_deg in points:
            ET.SubElement(detail, "link", point=f"{lat_deg:.7f},{_turned(lon_deg):.7f}")
        lon_deg, lat_deg = points[0]
        identity, place = _uid(live, name), (lat_deg, _turned(lon_deg))
        return Mark(identity, SHAPE, *place, self._how("m-f"), stale_s, ET.tostring(detail))

    def _detail(self, callsign: str, words: Iterable[str]) -> ET.Element:
        detail = ET.Element("detail")
        mark = "SIM " if self._simulated else ""
        ET.SubElement(detail, "contact", callsign=printable(f"{mark}{callsign}"))
        flags = ["simulated"] if self._simulated else []
        remarks = ET.SubElement(detail, "remarks")
        remarks.text = printable("; ".join(filter(None, [*flags, *words])))
        return detail


def _uid(live: LiveMap, name: str) -> str:
    place = f"{live.start.lat_deg:.7f},{live.start.lon_deg:.7f}"
    return f"uavmap-{uuid.uuid5(uuid.NAMESPACE_OID, f'{live.mission} {place}')}-{name}"


def _draw(detail: ET.Element, line: Colour, style: str, fill: Colour | None) -> None:
    ET.SubElement(detail, "strokeColor", value=str(argb(line)))
    ET.SubElement(detail, "strokeWeight", value="3.0")
    ET.SubElement(detail, "strokeStyle", value=style)
    if fill is not None:
        ET.SubElement(detail, "fillColor", value=str(argb(fill, 64)))
    ET.SubElement(detail, "labels_on", value="false")


def argb(colour: Colour, alpha: int = 255) -> int:
    """Return a colour as TAK writes it: alpha, red, green, blue as a signed number of 32 bits.

    >>> argb((255, 0, 0)), argb((0, 0, 255), 127)
    (-65536, 2130706687)
    """
    return int.from_bytes((alpha, *colour), signed=True)


def _thinned(line: LineString) -> LineString:
    """Return the line, simplified if it has too many points."""
    thinned, most_m = line, 0.5
    while len(thinned.coords) > MAX_POINTS:
        thinned, most_m = _simpler(line, most_m), 1.25 * most_m
    return thinned


def _simpler(line: LineString, most_m: float) -> LineString:
    return LineString(line.simplify(most_m).coords)


def _turned(lon_deg: float) -> float:
    """Return a longitude from -180 to 180 degrees.

    >>> _turned(180.5), _turned(-180.0)
    (-179.5, -180.0)
    """
    return (lon_deg + 180.0) % 360.0 - 180.0
