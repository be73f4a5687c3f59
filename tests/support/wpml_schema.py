"""DJI's waypoint files, checked with tables that follow its documentation.

Pages "Template.kml", "Waylines.wpml" and "Common Elements" of the Cloud API, DJI WPML 1.0.2. For
each element they give type, enumeration, range, and whether it is required. They give no order.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

KML = "{http://www.opengis.net/kml/2.2}"
WPML = "{http://www.dji.com/wpmz/1.0.2}"
TEMPLATE, WAYLINES = "wpmz/template.kml", "wpmz/waylines.wpml"
MAX_M_S = 15.0
"""Maximum speed of the aircraft in the tables between waypoints, m/s."""

Check = Callable[[str], bool]


def one_of(*values: object) -> Check:
    return lambda text: text in set(map(str, values))


def whole(low: int, high: int) -> Check:
    return lambda text: re.fullmatch(r"-?\d+", text) is not None and low <= int(text) <= high


def number(low: float, high: float, *, above: bool = False) -> Check:
    """Return a check of a range; with `above` its lower end is excluded."""

    def check(text: str) -> bool:
        if not re.fullmatch(r"-?\d+(\.\d+)?", text):
            return False
        return (low < float(text) if above else low <= float(text)) and float(text) <= high

    return check


@dataclass(frozen=True)
class Rule:
    """A rule for an element: if it is required, and its content, a text or other elements."""

    required: bool
    check: Check | None = None
    inside: Mapping[str, Rule] | None = None
    many: bool = False


def must(check: Check) -> Rule:
    return Rule(True, check)


def may(check: Check) -> Rule:
    return Rule(False, check)


BOOL, ID = one_of(0, 1), whole(0, 65535)
TEXT: Check = bool
TURNS = one_of(
    "coordinateTurn", "toPointAndStopWithDiscontinuityCurvature",
    "toPointAndStopWithContinuityCurvature", "toPointAndPassWithContinuityCurvature",
)  # fmt: skip
POSITION = whole(0, 2)


def several_of(*values: str) -> Check:
    return lambda text: set(text.split(",")) <= set(values)


LENSES = several_of("zoom", "wide", "ir", "narrow_band", "visable")


HEADING = {
    "waypointHeadingMode": must(
        one_of("followWayline", "manually", "fixed", "smoothTransition", "towardPOI")
    ),
    "waypointHeadingAngle": may(number(-180, 180)),
    "waypointPoiPoint": may(TEXT),
    "waypointHeadingPathMode": must(one_of("clockwise", "counterClockwise", "followBadArc")),
}
ROTATE = {
    "payloadPositionIndex": must(POSITION),
    "gimbalHeadingYawBase": must(one_of("north")),
    "gimbalRotateMode": must(one_of("absoluteAngle")),
    "gimbalPitchRotateEnable": must(BOOL),
    "gimbalPitchRotateAngle": must(number(-120, 45)),
    "gimbalRollRotateEnable": must(BOOL),
    "gimbalRollRotateAngle": must(number(-180, 180)),
    "gimbalYawRotateEnable": must(BOOL),
    "gimbalYawRotateAngle": must(number(-180, 180)),
    "gimbalRotateTimeEnable": must(BOOL),
    "gimbalRotateTime": must(number(0, 3600)),
}
PHOTO = {
    "payloadPositionIndex": must(POSITION),
    "fileSuffix": must(TEXT),
    "payloadLensIndex": must(LENSES),
    "useGlobalPayloadLensIndex": must(BOOL),
}
ACTS = {"gimbalRotate": ROTATE, "takePhoto": PHOTO}
"""Actions that `uavmap` writes, of those in the documentation."""
ACTION = {
    "actionId": must(ID),
    "actionActuatorFunc": must(one_of(*ACTS)),
    "actionActuatorFuncParam": Rule(True, inside=ROTATE | PHOTO),
}
TRIGGER = {
    "actionTriggerType": must(
        one_of("reachPoint", "betweenAdjacentPoints", "multipleTiming", "multipleDistance")
    ),
    "actionTriggerParam": may(number(0, 1e6, above=True)),
}
ACTION_GROUP = {
    "actionGroupId": must(ID),
    "actionGroupStartIndex": must(ID),
    "actionGroupEndIndex": must(ID),
    "actionGroupMode": must(one_of("sequence")),
    "actionTrigger": Rule(True, inside=TRIGGER),
    "action": Rule(True, inside=ACTION, many=True),
}
DRONE = {
    "droneEnumValue": must(one_of(89, 60, 67, 77, 91)),
    "droneSubEnumValue": may(one_of(0, 1, 2)),
}
CAMERA = {
    "payloadEnumValue": must(one_of(42, 43, 52, 53, 61, 66, 67, 68, 80, 81, 65534, 82, 83)),
    "payloadPositionIndex": must(POSITION),
}
MISSION = {
    "flyToWaylineMode": must(one_of("safely", "pointToPoint")),
    "finishAction": must(one_of("goHome", "noAction", "autoLand", "gotoFirstWaypoint")),
    "exitOnRCLost": must(one_of("goContinue", "executeLostAction")),
    "executeRCLostAction": may(one_of("goBack", "landing", "hover")),
    "takeOffSecurityHeight": must(number(1.2, 1500)),
    "globalTransitionalSpeed": must(number(0, MAX_M_S, above=True)),
    "droneInfo": Rule(True, inside=DRONE),
    "payloadInfo": Rule(True, inside=CAMERA),
}
SPEED = number(0, MAX_M_S, above=True)
POINT = {
    "Point": Rule(True, inside={"coordinates": must(TEXT)}),
    "index": must(ID),
    "useStraightLine": may(BOOL),
    "actionGroup": Rule(False, inside=ACTION_GROUP, many=True),
}
TEMPLATE_POINT = POINT | {
    "useGlobalHeight": must(BOOL),
    "ellipsoidHeight": may(number(-500, 9000)),
    "height": may(number(-500, 9000)),
    "useGlobalSpeed": must(BOOL),
    "useGlobalHeadingParam": must(BOOL),
    "useGlobalTurnParam": must(BOOL),
    "gimbalPitchAngle": may(number(-120, 45)),
}
TURN = {"waypointTurnMode": must(TURNS), "waypointTurnDampingDist": may(number(0, 1e5))}
WAYLINE_POINT = POINT | {
    "executeHeight": must(number(0, 1500, above=True)),
    "waypointSpeed": must(SPEED),
    "waypointHeadingParam": Rule(True, inside=HEADING),
    "waypointTurnParam": Rule(True, inside=TURN),
}
SYSTEM = {
    "coordinateMode": must(one_of("WGS84")),
    "heightMode": must(
        one_of("EGM96", "relativeToStartPoint", "aboveGroundLevel", "realTimeFollowSurface")
    ),
    "positioningType": may(one_of("GPS", "RTKBaseStation", "QianXun", "Custom")),
}
PAYLOAD = {
    "payloadPositionIndex": must(POSITION),
    "imageFormat": must(several_of("wide", "zoom", "ir", "narrow_band", "visible")),
}
TEMPLATE_FOLDER = {
    "templateType": must(one_of("waypoint", "mapping2d", "mapping3d", "mappingStrip")),
    "templateId": must(ID),
    "waylineCoordinateSysParam": Rule(True, inside=SYSTEM),
    "autoFlightSpeed": must(SPEED),
    "globalHeight": must(number(0, 1500, above=True)),
    "gimbalPitchMode": must(one_of("manual", "usePointSetting")),
    "globalWaypointHeadingParam": Rule(True, inside=HEADING),
    "globalWaypointTurnMode": must(TURNS),
    "globalUseStraightLine": may(BOOL),
    "payloadParam": Rule(True, inside=PAYLOAD),
    "Placemark": Rule(True, inside=TEMPLATE_POINT, many=True),
}
WAYLINES_FOLDER = {
    "templateId": must(ID),
    "waylineId": must(ID),
    "autoFlightSpeed": must(SPEED),
    "executeHeightMode": must(one_of("WGS84", "relativeToStartPoint", "realTimeFollowSurface")),
    "Placemark": Rule(True, inside=WAYLINE_POINT, many=True),
}
TEMPLATE_RULES = {
    "author": may(TEXT),
    "createTime": may(whole(0, 10**15)),
    "updateTime": may(whole(0, 10**15)),
    "missionConfig": Rule(True, inside=MISSION),
    "Folder": Rule(True, inside=TEMPLATE_FOLDER),
}
RTH = {"globalRTHHeight": must(number(0, 1500, above=True))}
WAYLINES_RULES = {
    "missionConfig": Rule(True, inside=MISSION | RTH),
    "Folder": Rule(True, inside=WAYLINES_FOLDER),
}
OF_KML = {"Folder", "Placemark", "Point", "coordinates"}
"""Elements of KML itself; all others are in DJI's namespace."""


def tag(name: str) -> str:
    return (KML if name in OF_KML else WPML) + name


def text(element: Element | None, *path: str) -> str:
    """Return the text of an element below another."""
    return "" if element is None else (element.findtext("/".join(map(tag, path))) or "").strip()


def opened(data: bytes) -> dict[str, Element]:
    """Return the documents of an archive, by the names of their files."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.testzip() is None
        roots = {name: ElementTree.fromstring(archive.read(name)) for name in archive.namelist()}
    return {name: root[0] for name, root in roots.items()}


def faults_of(data: bytes) -> list[str]:
    """Return the differences between a file and the documentation."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if archive.namelist() != [TEMPLATE, WAYLINES]:
            return [f"holds {archive.namelist()}"]
    files = opened(data)
    rules = {TEMPLATE: TEMPLATE_RULES, WAYLINES: WAYLINES_RULES}
    faults = [
        f"{name}: {fault}"
        for name, document in files.items()
        for fault in [*_faults(document, rules[name]), *_of_points(document)]
    ]
    if not faults:
        template, waylines = (places(files[name]) for name in rules)
        faults += ["the two files have other waypoints"] * (template != waylines)
    return faults


def places(document: Element) -> list[tuple[float, float]]:
    """Return longitudes and latitudes of the waypoints."""
    return [
        (float(lon), float(lat))
        for point in document.iter(tag("Placemark"))
        for lon, lat in [text(point, "Point", "coordinates").split(",")]
    ]


def _faults(parent: Element, rules: Mapping[str, Rule]) -> Iterator[str]:
    found = Counter(child.tag for child in parent)
    names = {tag(name): name for name in rules}
    yield from (f"{child} is not documented there" for child in found if child not in names)
    for name, rule in rules.items():
        count = found[tag(name)]
        if (rule.required and not count) or (count > 1 and not rule.many):
            yield f"{count} {name} in {parent.tag}"
        for element in parent.findall(tag(name)):
            if rule.inside is not None:
                yield from _faults(element, _chosen(name, parent, rule.inside))
            elif rule.check is not None and not rule.check((element.text or "").strip()):
                yield f"{name} = {element.text!r}"


def _chosen(name: str, parent: Element, inside: Mapping[str, Rule]) -> Mapping[str, Rule]:
    """Return the parameters of the action of an element."""
    if name != "actionActuatorFuncParam":
        return inside
    return ACTS.get(text(parent, "actionActuatorFunc"), inside)


def _of_points(document: Element) -> Iterator[str]:
    """Return the faults of indices, groups and dependent elements, which no table can hold."""
    mission = document.find(tag("missionConfig"))
    leaves = mission is not None and text(mission, "exitOnRCLost") == "executeLostAction"
    if leaves and not text(mission, "executeRCLostAction"):
        yield "executeRCLostAction is missing"
    points = list(document.iter(tag("Placemark")))
    indices = [text(point, "index") for point in points]
    if len(points) < 2 or indices != [str(index) for index in range(len(points))]:
        yield f"indices {indices}"
    groups = list(document.iter(tag("actionGroup")))
    if sorted(text(g, "actionGroupId") for g in groups) != sorted(map(str, range(len(groups)))):
        yield "numbers of action groups"
    for group in groups:
        first, last = (text(group, f"actionGroup{end}Index") for end in ("Start", "End"))
        if not (first.isdigit() and last.isdigit() and int(first) <= int(last) < len(points)):
            yield f"action group from {first} to {last}"
        kind = text(group, "actionTrigger", "actionTriggerType")
        if kind.startswith("multiple") and not text(group, "actionTrigger", "actionTriggerParam"):
            yield "actionTriggerParam is missing"
    for point in points:
        lon, _, lat = text(point, "Point", "coordinates").partition(",")
        if not (number(-180, 180)(lon) and number(-90, 90)(lat)):
            yield f"coordinates {lon},{lat}"
        if text(point, "useGlobalHeight") == "0" and not text(point, "height"):
            yield "height is missing"
    mode = next(document.iter(tag("gimbalPitchMode")), None)
    by_point = mode is not None and mode.text == "usePointSetting"
    if by_point and not all(text(point, "gimbalPitchAngle") for point in points):
        yield "gimbalPitchAngle is missing"
