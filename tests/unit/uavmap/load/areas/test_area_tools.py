"""Content that tools write and `uavmap new` reads in part or not at all: a line names the remedy.

No link is followed, and no entity resolved.
"""

from __future__ import annotations

import json

import pytest
import shapely

from tests.support.areas import area_files as files
from tests.support.areas.area_files import (
    FIELD,
    POND,
    STRUCTURE,
    by_gdal,
    gpx,
    kml,
    placemark,
    saved,
    zipped,
)
from tests.unit.uavmap.load.areas.test_area_faults import Maker, assert_refused, plan, text
from uavmap.load.areas.reading import read_area_file

SECRET = "13.1,52.1 13.2,52.1 13.2,52.2"
XINCLUDE = (
    '<kml xmlns:xi="http://www.w3.org/2001/XInclude"><Placemark><name>a</name><Polygon>'
    '<outerBoundaryIs><LinearRing><coordinates><xi:include href="secret.txt" parse="text"/>'
    "</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>"
)
LAUGHS = (
    '<?xml version="1.0"?><!DOCTYPE gpx [<!ENTITY a "ha">'
    + "".join(f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(20))
    + '{}]><gpx version="1.1"><trk><name>&{};</name></trk></gpx>'
)
PARAMETER = '<!DOCTYPE kml [<!ENTITY % x SYSTEM "http://127.0.0.1:9/x.dtd"> %x;]><kml/>'
LINKED = "<NetworkLink><Link><href>{}</href></Link></NetworkLink>"
WAYPOINTS = "".join(placemark("", files.point(corner)) for corner in FIELD)


def kmz(**members: str | bytes) -> Maker:
    return text("a.kmz", zipped({f"{name}.kml": content for name, content in members.items()}))


def gdal(name: str, driver: str) -> Maker:
    return lambda folder: by_gdal(folder, name, driver)


def corridor(**more: object) -> Maker:
    item = {
        "type": "ComplexItem", "complexItemType": "CorridorScan", "CorridorWidth": 20,
        "polyline": files.lat_lon(FIELD[:2]), **more,
    }  # fmt: skip
    return plan(mission={"items": [item]})


EIGHT = [FIELD[0], FIELD[2], FIELD[3], FIELD[1], FIELD[0]]
REFUSED: dict[str, tuple[Maker, str]] = {
    # hostile
    "a GPX with entities": (text("a.gpx", LAUGHS.format("", "u")), "document type or entities"),
    "a KML of a parameter outside": (text("a.kml", PARAMETER), "document type or entities"),
    "a KMZ that links to a KML with entities": (
        kmz(doc=kml(LINKED.format("b.kml")), b=PARAMETER), "document type or entities",
    ),
    "a KMZ that links out of itself": (
        kmz(doc=kml(LINKED.format("../secret.txt"))), "a link to another file",
    ),
    "a KMZ that links to itself": (
        kmz(doc=kml(LINKED.format("doc.kml"))), "a link to another file",
    ),
    "a KMZ that links to 40 MB": (
        kmz(
            doc=kml(LINKED.format("b.kml") + LINKED.format("c.kml")),
            b=b" " * 15_000_000, c=b" " * 15_000_000,
        ),
        "unpack to more than 20 MB",
    ),
    "network links in one another": (
        text("a.kml", kml("<NetworkLink>" * 50_000 + "</NetworkLink>" * 50_000)), "a link to",
    ),
    "XInclude": (
        lambda folder: [
            saved(folder, "secret.txt", SECRET), saved(folder, "a.kml", XINCLUDE),
        ][1],
        "0 corners",
    ),
    # of other tools
    "OpenStreetMap's XML": (text("map.osm", "<osm version='0.6'/>"), "export it as GeoJSON"),
    "GML of GDAL": (gdal("a.gml", "GML"), "GML; export it as GeoJSON"),
    "a project of QGIS": (text("a.qgs", "<qgis version='3.34'/>"), "export the layer"),
    "a packed project of QGIS": (text("a.qgz", zipped({"a.qgs": "<qgis/>"})), "without a .kml"),
    "a mission of UgCS": (text("a.xml", "<ugcs-Transfer/>"), "export its route as KML"),
    "a route of UgCS": (text("a.json", '{"version": {}, "route": {}}'), "save the polygon as"),
    "an SVG": (text("a.svg", "<svg xmlns='http://www.w3.org/2000/svg'/>"), "its root is 'svg'"),
    "MapInfo": (gdal("a.mif", "MapInfo File"), "export the area as one of these: GeoPackage"),
    "DXF": (text("a.dxf", "  0\nSECTION\n  2\nENTITIES\n"), "export the area as one of these"),
    "a log of a flight": (text("a.tlog", b"\0\5\xfd\t\0\0"), "export the area as one of these"),
    "DJI's waypoints": (
        text("a.kmz", zipped({"wpmz/template.kml": kml(f"<Folder>{WAYPOINTS}</Folder>")})),
        "holds no polygon",
    ),
    "a mission of an old QGroundControl": (
        text("a.mission", json.dumps({"fileType": "Mission", "items": []})),
        "open it there, and save it as a plan",
    ),
    "a structure scan": (plan(mission={"items": [STRUCTURE]}), "draw a survey around it"),
    "a corridor without a width": (corridor(CorridorWidth=0), "two points and a width"),
    "a corridor of one point": (corridor(polyline=[[52.0, 13.0]]), "two points and a width"),
    "a corridor of one place": (corridor(polyline=[[52.0, 13.0]] * 2), "no length"),
    "a corridor of a thousand bends": (
        corridor(polyline=[[52.0 + k % 7 / 100, 13.0 + k % 5 / 100] for k in range(1000)]),
        "simplify it to at most 300",
    ),
    "a corridor beyond the pole": (corridor(polyline=[[95.0, 13.0]] * 2), "not latitude"),
    "rally points": (text("a.rally", "RALLY 52.4 13.3 30 20 0 0\n"), "rally points alone"),
    # GPX and tables
    "a GPX of a way to somewhere": (text("a.gpx", gpx(tracks={"way": FIELD})), "do not return"),
    "a GPX without degrees": (
        text("a.gpx", "<gpx><trk><trkseg><trkpt lat='x'/></trkseg></trk></gpx>"), "not degrees",
    ),
    "a GPX with NaN": (
        text("a.gpx", "<gpx><trk><trkseg><trkpt lat='nan' lon='1'/></trkseg></trk></gpx>"),
        "is no coordinate",
    ),
    "a table of words": (text("a.csv", "lat,lon\nhere,there\n"), "has no latitude and longitude"),
    "a table with short rows": (text("a.csv", "id,lat,lon\n1,2\n"), "row 2"),
    "WKT that is none": (text("a.csv", "wkt\nPOLYGON ((1 2\n"), "is not WKT"),
    "WKT of a point": (text("a.csv", "wkt\nPOINT (1 2)\n"), "holds no polygon"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_unusable_file_is_refused_with_a_remedy(case, tmp_path):
    assert_refused(*REFUSED[case], tmp_path)


def test_tracks_left_out_are_reported(tmp_path):
    tracks = {"Field": [*FIELD, FIELD[0]], "to it": FIELD[:2]}
    drawing = read_area_file(str(saved(tmp_path, "a.gpx", gpx(tracks=tracks))))
    assert "1 tracks or routes are left out" in drawing.notices[0]
    eight = read_area_file(str(saved(tmp_path, "8.gpx", gpx(tracks={"Eight": EIGHT}))))
    assert len(eight.areas[0].ring) == 4  # for a real flight: the layout reports it
    line = {"type": "LineString", "coordinates": FIELD}
    made = files.collection(files.feature(), {"type": "Feature", "geometry": line})
    drawing = read_area_file(str(saved(tmp_path, "a.geojson", made)))
    assert drawing.notices == ("open paths are left out; an area is a polygon",)


def test_track_that_crosses_itself_often_is_read_quickly(tmp_path):
    star = [(13.0 + k * 97 % 151 / 1e4, 52.0 + k * 61 % 149 / 1e4) for k in range(150)]
    drawing = read_area_file(str(saved(tmp_path, "a.gpx", gpx(tracks={"w": [*star, star[0]]}))))
    assert drawing.notices == ()
    assert len(drawing.areas[0].ring) == 150


def test_structure_scan_beside_a_survey_is_reported(tmp_path):
    path = plan(mission={"items": [files.SURVEY, STRUCTURE]})(tmp_path)
    drawing = read_area_file(str(path))
    assert "a structure scan is left out" in drawing.notices[0]


def test_corridor_of_a_bent_line_has_its_width_everywhere(tmp_path):
    bent = files.lat_lon([FIELD[0], FIELD[1], FIELD[2]])
    (area,) = read_area_file(str(corridor(polyline=bent)(tmp_path))).areas
    east_m = 111_447.0 * 0.60924  # a degree of longitude at 52.4565 degrees
    ground = shapely.Polygon([(p.lon_deg * east_m, p.lat_deg * 111_270.0) for p in area.ring])
    assert ground.area == pytest.approx(20.0 * (101.8 + 111.3), rel=0.01)


def test_table_of_wkt_has_its_holes_and_names(tmp_path):
    shape = shapely.Polygon(FIELD, [POND])
    rows = ["name;wkt", f"North;{shape.wkt}", f"Geofence;{shape.buffer(0.001).wkt}"]
    drawing = read_area_file(str(saved(tmp_path, "a.csv", "\n".join(rows))))
    assert [area.name for area in drawing.areas] == ["North"]
    assert len(drawing.areas[0].holes) == 1
    assert len(drawing.fences) == 1
    assert "names no coordinate system" in drawing.notices[0]


def test_outline_of_many_corners_fits_into_a_cell(tmp_path):
    coast = shapely.Point(13.303, 52.456).buffer(0.001, quad_segs=1500)
    (area,) = read_area_file(str(saved(tmp_path, "a.csv", f'wkt\n"{coast.wkt}"'))).areas
    assert len(area.ring) == 6000
