"""Waypoint files of DJI aircraft (WPML, a KMZ): `wpmz/template.kml` and `wpmz/waylines.wpml`.

DJI Pilot 2 and FlightHub 2 show and edit the template; an aircraft flies the waylines. Both have
the same waypoints. Elements, order and values are those of DJI's Cloud API documentation, DJI WPML
1.0.2. Heights are above the place of take-off. The format has no fence: the path stays inside the
fence of the mission.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import OutputError
from missions.units import LatLon
from uavmap.output.facts.flown_mission import FlownMission
from uavmap.output.formats.archive_bytes import zipped
from uavmap.output.formats.follow_up import follow_up_flight
from uavmap.output.formats.ground_station_plan import DECIMALS, SearchFlight
from uavmap.output.formats.kml_encoder import NAMESPACE
from uavmap.output.formats.layers import Layer

WPML: Final = "http://www.dji.com/wpmz/1.0.2"
MAX_M_S: Final = 15.0
"""Maximum speed between waypoints, m/s."""
MAX_WAYPOINTS: Final = 65_536


class Aircraft(NamedTuple):
    """Numbers of an aircraft and of its camera in DJI's tables."""

    drone: int
    variant: int
    camera: int


AIRCRAFT: Final[Mapping[str, Aircraft]] = {
    "M3E": Aircraft(77, 0, 66),
    "M3T": Aircraft(77, 1, 67),
    "M3M": Aircraft(77, 2, 68),
    "M30": Aircraft(67, 0, 52),
    "M30T": Aircraft(67, 1, 53),
    "M3D": Aircraft(91, 0, 80),
    "M3TD": Aircraft(91, 1, 81),
}
"""Aircraft with a built-in camera; the numbers of other aircraft depend on their payload."""
USUAL: Final = "M3E"
_LOG: Final = logging.getLogger("uavmap.output")


def encode(flown: FlownMission, layers: Sequence[Layer], drone: str = USUAL) -> bytes:
    """Encode a flight over the mapped region, for a drone of `AIRCRAFT`. Raises `OutputError`."""
    return wpml_archive(follow_up_flight(flown), drone)


def wpml_archive(flight: SearchFlight, drone: str) -> bytes:
    """Encode the flight of one vehicle for a drone of `AIRCRAFT`. Raises `OutputError`."""
    if flight.speed_m_s > MAX_M_S:
        raise OutputError(
            f"flight.speed_m_s = {flight.speed_m_s:g}: these aircraft fly waypoints at up to "
            f"{MAX_M_S:g} m/s; lower the speed"
        )
    route = Route.from_flight(flight)
    if len(route.places) > MAX_WAYPOINTS:
        raise OutputError(
            f"{len(route.places)} waypoints: the format allows {MAX_WAYPOINTS}; make the cells "
            "larger (grid.cell_m), or the area smaller"
        )
    if route.spans:
        apart_s = route.spans[0].every_m / route.speed_m_s
        _LOG.info(
            f"pictures are {apart_s:.1f} s apart at {route.speed_m_s:.1f} m/s; if the camera of "
            f"the {drone} needs more time, lower the speed in DJI Pilot 2"
        )
    aircraft = AIRCRAFT[drone]
    return zipped({
        "wpmz/template.kml": _document(_template(route, aircraft)),
        "wpmz/waylines.wpml": _document(_waylines(route, aircraft)),
    })  # fmt: skip


class Span(NamedTuple):
    """A picture each `every_m` metres from one waypoint to another; both are counted from 0."""

    first: int
    last: int
    every_m: float


class Route(NamedTuple):
    """Waypoints with one height above the place of take-off, m, and one speed, m/s."""

    places: tuple[LatLon, ...]
    spans: tuple[Span, ...]
    height_m: float
    speed_m_s: float

    @classmethod
    def from_flight(cls, flight: SearchFlight) -> Route:
        """Create the route of a flight's items; the aircraft returns after the last waypoint."""
        places, spans, begun = list[LatLon](), list[Span](), (0, 0.0)
        for item in flight.items:
            if item.command in (mav.MAV_CMD_NAV_TAKEOFF, mav.MAV_CMD_NAV_WAYPOINT):
                places.append(item.position)
            elif item.command == mav.MAV_CMD_DO_SET_CAM_TRIGG_DIST:
                if item.first:
                    begun = len(places) - 1, item.first
                else:
                    spans.append(Span(begun[0], len(places) - 1, begun[1]))
        return cls(tuple(places), tuple(spans), flight.items[0].height_m, flight.speed_m_s)


# --- the two files --------------------------------------------------------------------------------
def _document(parts: Iterator[str]) -> bytes:
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<kml xmlns="{NAMESPACE}" xmlns:wpml="{WPML}">\n<Document>\n{"".join(parts)}'
        "</Document>\n</kml>\n"
    ).encode()


def _template(route: Route, aircraft: Aircraft) -> Iterator[str]:
    yield _values(author="uavmap")
    yield from _mission(route, aircraft)
    yield "<Folder>\n"
    yield _values(templateType="waypoint", templateId=0)
    system = _values(
        coordinateMode="WGS84", heightMode="relativeToStartPoint", positioningType="GPS"
    )
    yield _group("waylineCoordinateSysParam", system)
    yield _values(
        autoFlightSpeed=_metres(route.speed_m_s),
        globalHeight=_metres(route.height_m),
        gimbalPitchMode="usePointSetting",
    )
    yield _group("globalWaypointHeadingParam", _HEADING)
    yield _values(globalWaypointTurnMode=_TURN, globalUseStraightLine=1)
    for number, place in enumerate(route.places):
        yield _point(number, place)
        yield _values(
            ellipsoidHeight=_metres(route.height_m),  # DJI Pilot 2 writes the same number here
            height=_metres(route.height_m),
            useGlobalHeight=1,
            useGlobalSpeed=1,
            useGlobalHeadingParam=1,
            useGlobalTurnParam=1,
            gimbalPitchAngle=-90,
        )
        yield from _actions(route, number)
        yield "</Placemark>\n"
    yield _group("payloadParam", _values(payloadPositionIndex=0, imageFormat=_LENS))
    yield "</Folder>\n"


def _waylines(route: Route, aircraft: Aircraft) -> Iterator[str]:
    yield from _mission(route, aircraft, globalRTHHeight=_metres(route.height_m))
    yield "<Folder>\n"
    yield _values(
        templateId=0,
        executeHeightMode="relativeToStartPoint",
        waylineId=0,
        autoFlightSpeed=_metres(route.speed_m_s),
    )
    for number, place in enumerate(route.places):
        yield _point(number, place)
        yield _values(executeHeight=_metres(route.height_m), waypointSpeed=_metres(route.speed_m_s))
        yield _group("waypointHeadingParam", _HEADING)
        turn = _values(waypointTurnMode=_TURN, waypointTurnDampingDist=0)
        yield _group("waypointTurnParam", turn)
        yield _values(useStraightLine=1)
        yield from _actions(route, number)
        yield "</Placemark>\n"
    yield "</Folder>\n"


def _mission(route: Route, aircraft: Aircraft, **more: object) -> Iterator[str]:
    """Write the settings of the flight: an aircraft that loses its operator returns."""
    values = _values(
        flyToWaylineMode="safely",
        finishAction="goHome",
        exitOnRCLost="executeLostAction",
        executeRCLostAction="goBack",
        takeOffSecurityHeight=_metres(route.height_m),
        globalTransitionalSpeed=_metres(route.speed_m_s),
        **more,
    )
    drone = _values(droneEnumValue=aircraft.drone, droneSubEnumValue=aircraft.variant)
    camera = _values(payloadEnumValue=aircraft.camera, payloadPositionIndex=0)
    parts = values + _group("droneInfo", drone) + _group("payloadInfo", camera)
    yield _group("missionConfig", parts)


# --- waypoints ------------------------------------------------------------------------------------
_TURN: Final = "toPointAndStopWithDiscontinuityCurvature"
"""Mode of turns: straight to each waypoint, with a stop; a curve might leave the fence."""
_LENS: Final = "wide"


def _point(number: int, place: LatLon) -> str:
    at = f"{place.lon_deg:.{DECIMALS}f},{place.lat_deg:.{DECIMALS}f}"
    return f"<Placemark><Point><coordinates>{at}</coordinates></Point>\n{_values(index=number)}"


def _actions(route: Route, number: int) -> Iterator[str]:
    """Point the camera down at the first waypoint; take pictures from the beginning of lanes."""
    if number == 0:
        down = _values(
            gimbalHeadingYawBase="north",
            gimbalRotateMode="absoluteAngle",
            gimbalPitchRotateEnable=1,
            gimbalPitchRotateAngle=-90,
            gimbalRollRotateEnable=0,
            gimbalRollRotateAngle=0,
            gimbalYawRotateEnable=0,
            gimbalYawRotateAngle=0,
            gimbalRotateTimeEnable=0,
            gimbalRotateTime=0,
            payloadPositionIndex=0,
        )
        yield _action_group(
            0, (0, 0), _values(actionTriggerType="reachPoint"), "gimbalRotate", down
        )
    for group, (first, last, every_m) in enumerate(route.spans, start=1):
        if first == number:
            trigger = _values(
                actionTriggerType="multipleDistance", actionTriggerParam=_metres(every_m)
            )
            picture = _values(
                payloadPositionIndex=0,
                fileSuffix=f"lane{group}",
                payloadLensIndex=_LENS,
                useGlobalPayloadLensIndex=1,
            )
            yield _action_group(group, (first, last), trigger, "takePhoto", picture)


def _action_group(
    number: int, where: tuple[int, int], trigger: str, act: str, parameters: str
) -> str:
    head = _values(
        actionGroupId=number,
        actionGroupStartIndex=where[0],
        actionGroupEndIndex=where[1],
        actionGroupMode="sequence",
    )
    action = _values(actionId=0, actionActuatorFunc=act)
    action += _group("actionActuatorFuncParam", parameters)
    return _group("actionGroup", head + _group("actionTrigger", trigger) + _group("action", action))


# --- elements -------------------------------------------------------------------------------------
def _values(**values: object) -> str:
    return "".join(f"<wpml:{name}>{value}</wpml:{name}>\n" for name, value in values.items())


def _group(name: str, inside: str) -> str:
    return f"<wpml:{name}>\n{inside}</wpml:{name}>\n"


def _metres(value: float) -> str:
    return f"{value:.3f}".rstrip("0").rstrip(".")


_HEADING: Final = _values(
    waypointHeadingMode="followWayline",
    waypointHeadingAngle=0,
    waypointHeadingPathMode="followBadArc",
)
