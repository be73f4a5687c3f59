from __future__ import annotations

import json
import math

import cv2
import numpy as np
import pyproj
import pytest
from PIL import Image, TiffImagePlugin

from missions.errors import WorldError
from missions.geo.geodesy import LocalPlane, UtmZone
from missions.units import LatLon
from sitl.camera.pinhole import Shot, ground_to_pixel
from sitl.camera.render import render
from sitl.world.files import load_ground, load_orthophoto, load_patches
from sitl.world.world import World, WorldSpec
from tests.unit.sitl.conftest import CAMERA, decoded

HOME = LatLon(48.0, 11.0)
PLANE = LocalPlane(HOME)
ZONE = UtmZone.containing(HOME)
SPOT = (40, 30)  # place of the red square in the pictures, metres east and north of home
SIZE_M, PIXEL_M = 160.0, 0.25


def ring(*points):
    """Return a closed GeoJSON ring around points in metres from home."""
    places = [PLANE.to_wgs84(e, n) for e, n in (*points, points[0])]
    return [[p.lon_deg, p.lat_deg] for p in places]


SQUARE = ring((0, 0), (20, 0), (20, 20), (0, 20))
HOLE = ring((8, 8), (12, 8), (12, 12), (8, 12))
FAR = ring((100, 0), (120, 0), (120, 20), (100, 20))


def saved(tmp_path, value, name="a.geojson"):
    path = tmp_path / name
    path.write_text(json.dumps(value))
    return path


def polygon(*rings):
    return {"type": "Polygon", "coordinates": list(rings)}


# --- GeoJSON ------------------------------------------------------------------------------------
def test_every_shape_of_geojson_is_read(tmp_path):
    feature = {"type": "Feature", "properties": {}, "geometry": polygon(SQUARE, HOLE)}
    several = {"type": "MultiPolygon", "coordinates": [[SQUARE, HOLE], [FAR]]}
    everything = {
        "type": "FeatureCollection",
        "features": [
            feature,
            {"type": "Feature", "properties": None, "geometry": None},
            {
                "type": "Feature",
                "geometry": {"type": "GeometryCollection", "geometries": [several]},
            },
        ],
    }
    for value, count, area_m2 in (
        (polygon(SQUARE), 1, 400.0),
        (feature, 1, 384.0),
        (several, 2, 784.0),
        (everything, 3, 784.0),  # one of the three is there twice
    ):
        patches = load_patches(saved(tmp_path, value))
        assert len(patches) == count
        world = World(WorldSpec(HOME, 0.0, patches))
        assert world.roi_at_rest.area == pytest.approx(area_m2, rel=1e-4)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({"type": "FeatureCollection", "features": []}, "no Polygon"),
        ({"type": "Point", "coordinates": [11.0, 48.0]}, "Point"),
        ([1, 2], "without a type"),
        ({"type": "Polygon"}, "coordinates"),
        (polygon(SQUARE[:-1]), "the last equal to the first"),
        (polygon([[500.0, 10.0]] * 4), "in degrees"),
        (polygon([[float("nan"), 10.0]] * 4), "in degrees"),
        (polygon([["11", "48"]] * 4), "polygon 1"),
        (polygon(7), "polygon 1"),
        (polygon(ring((0, 0), (20, 20), (20, 0), (0, 20))), "crosses itself"),
        (polygon(SQUARE, FAR), "hole lies outside"),
    ],
)
def test_geojson_that_is_no_world_is_refused(tmp_path, value, message):
    path = saved(tmp_path, value)
    with pytest.raises(WorldError, match=message) as caught:
        load_ground([path])
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_invalid_or_missing_files_are_refused(tmp_path):
    text = tmp_path / "a.json"
    text.write_text("{")
    with pytest.raises(WorldError, match="not JSON"):
        load_ground([text])
    with pytest.raises(WorldError, match="No such file"):
        load_ground([tmp_path / "b.geojson"])
    with pytest.raises(WorldError, match="no such file"):
        load_ground([tmp_path / "b.png"])
    text.rename(tmp_path / "a.png")
    with pytest.raises(WorldError, match="neither GeoJSON nor"):
        load_ground([tmp_path / "a.png"])


def test_a_world_elsewhere_is_an_error(tmp_path):
    swapped = [[lat, lon] for lon, lat in SQUARE]
    with pytest.raises(WorldError, match="km from home"):
        load_ground([saved(tmp_path, polygon(swapped))], home=HOME)


# --- pictures -----------------------------------------------------------------------------------
def picture(red=True):
    """Return a green picture with a red square of 2 m at SPOT; its middle is home."""
    side = round(SIZE_M / PIXEL_M)
    pixels = np.full((side, side, 3), (40, 150, 60), np.uint8)
    if red:
        column, row = (side / 2 + SPOT[0] / PIXEL_M, side / 2 - SPOT[1] / PIXEL_M)
        reach = round(1.0 / PIXEL_M)
        rows = slice(round(row) - reach, round(row) + reach)
        pixels[rows, round(column) - reach : round(column) + reach] = (220, 20, 20)
    return Image.fromarray(pixels)


def degrees_affine():
    """Return the transform of pixels to degrees, true north up, in the plane of home."""
    east, north = PLANE.to_wgs84(1.0, 0.0), PLANE.to_wgs84(0.0, 1.0)
    dlon, dlat = east.lon_deg - HOME.lon_deg, north.lat_deg - HOME.lat_deg
    corner = (HOME.lon_deg - SIZE_M / 2 * dlon, HOME.lat_deg + SIZE_M / 2 * dlat)
    return PIXEL_M * dlon, -PIXEL_M * dlat, *corner


def utm_affine(epsg=ZONE.epsg):
    """Return the transform of pixels to metres of the projection, grid north up."""
    project = pyproj.Transformer.from_crs(4326, epsg, always_xy=True)
    x, y = project.transform(HOME.lon_deg, HOME.lat_deg)
    return PIXEL_M, -PIXEL_M, x - SIZE_M / 2, y + SIZE_M / 2


def with_world_file(tmp_path, name, suffix, affine):
    a, e, x, y = affine
    picture().save(tmp_path / name, **({"quality": 95} if "jp" in name else {}))
    numbers = (a, 0.0, 0.0, e, x + a / 2, y + e / 2)  # of the centre of the first pixel
    (tmp_path / name).with_suffix(suffix).write_text("\n".join(f"{n:.14f}" for n in numbers))
    return tmp_path / name


def geotiff(tmp_path, affine, keys, *, transformation=False, point=False, image=None):
    a, e, x, y = affine
    if point:
        x, y = x + a / 2, y + e / 2
        keys = {**keys, 1025: 2}
    info = TiffImagePlugin.ImageFileDirectory_v2()
    if transformation:
        info[34264] = (a, 0.0, 0.0, x, 0.0, e, 0.0, y, *([0.0] * 7), 1.0)
        info.tagtype[34264] = 12
    else:
        info[33550], info[33922] = (a, -e, 0.0), (0.0, 0.0, 0.0, x, y, 0.0)
        info.tagtype[33550] = info.tagtype[33922] = 12
    entries = [n for key, value in sorted(keys.items()) for n in (key, 0, 1, value)]
    info[34735] = (1, 1, 0, len(keys), *entries)
    info.tagtype[34735] = 3
    path = tmp_path / "ground.tif"
    (image or picture()).save(path, tiffinfo=info, compression="tiff_adobe_deflate")
    return path


def where_is_red(photo, shot, **world):
    """Return the centre of the red square in a rendered picture, from its middle."""
    spec = {"texture": 0.0, "sensor_noise": 0.0, "illumination": 0.0, **world}
    data = render(World(WorldSpec(HOME, 0.0, (), orthophoto=photo, **spec)), CAMERA, shot)
    view = decoded(data, cv2.IMREAD_COLOR).astype(int)
    rows, columns = np.nonzero((view[:, :, 2] > 130) & (view[:, :, 1] < 100))
    assert len(rows) > 20
    return columns.mean() - 199.5, rows.mean() - 149.5, len(rows)


def over(east_m, north_m, height_m=10.0):
    attitude = CAMERA.attitude(0.0, 0.0, 0.0)
    return Shot(east_m, north_m, height_m - 0.1, attitude, 0.0, 0)


def files(tmp_path):
    utm, degrees = {1024: 1, 1025: 1, 3072: ZONE.epsg}, {1024: 2, 1025: 1, 2048: 4326}
    yield with_world_file(tmp_path, "a.png", ".pgw", degrees_affine()), None
    yield with_world_file(tmp_path, "b.jpg", ".jgw", utm_affine()), ZONE.epsg
    yield with_world_file(tmp_path, "c.png", ".wld", utm_affine(25832)), 25832
    yield geotiff(tmp_path, degrees_affine(), degrees), None
    yield geotiff(tmp_path, utm_affine(), utm), None
    yield geotiff(tmp_path, utm_affine(), utm, transformation=True), None
    yield geotiff(tmp_path, utm_affine(), utm, point=True), None


def test_spot_is_where_the_file_places_it(tmp_path):
    """In degrees it is at SPOT of true north; UTM's grid north is turned by the convergence."""
    for number, (path, epsg) in enumerate(files(tmp_path)):
        photo = load_orthophoto(path, epsg)
        if number in (0, 3):
            east, north = SPOT
        else:
            turned = ZONE.convergence_rad(HOME)
            scale = ZONE.scale(HOME)
            east = (SPOT[0] * math.cos(turned) + SPOT[1] * math.sin(turned)) / scale
            north = (SPOT[1] * math.cos(turned) - SPOT[0] * math.sin(turned)) / scale
        # 20 pixels a metre: seen from 3 m west and 2 m south of it
        u, v, size = where_is_red(photo, over(east - 3.0, north - 2.0))
        assert (u, v) == pytest.approx((60.0, -40.0), abs=1.5), path
        assert size == pytest.approx(40 * 40, rel=0.2)


def test_a_tilted_and_turned_camera_sees_the_same_ground(tmp_path):
    path = with_world_file(tmp_path, "a.png", ".pgw", degrees_affine())
    photo = load_orthophoto(path)
    attitude = CAMERA.attitude(0.1, -0.2, 2.0)
    shot = Shot(SPOT[0] - 1.0, SPOT[1] + 1.5, 9.9, attitude, 0.0, 0)
    x, y, depth = ground_to_pixel(CAMERA, shot) @ (1.0, -1.5, 1.0)
    u, v, _ = where_is_red(photo, shot)
    assert (u, v) == pytest.approx((x / depth - 199.5, y / depth - 149.5), abs=2.0)


def test_picture_from_high_up_is_reduced(tmp_path):
    photo = load_orthophoto(with_world_file(tmp_path, "a.png", ".pgw", degrees_affine()))
    u, v, _ = where_is_red(photo, over(SPOT[0] - 12.0, SPOT[1], height_m=60.0))
    assert (u, v) == pytest.approx((40.0, 0.0), abs=1.5)


def test_picture_beyond_its_edge_and_where_it_is_transparent_is_meadow(tmp_path):
    image = picture(red=False).convert("RGBA")
    image.paste((0, 0, 0, 0), (0, 0, 320, 640))  # the western half
    keys = {1024: 1, 1025: 1, 3072: ZONE.epsg}
    photo = load_orthophoto(geotiff(tmp_path, utm_affine(), keys, image=image))
    plain = {"texture": 0.0, "sensor_noise": 0.0, "illumination": 0.0}
    world = World(WorldSpec(HOME, 0.0, (), orthophoto=photo, **plain))
    for east in (0.0, SIZE_M / 2):
        view = decoded(render(world, CAMERA, over(east, 0.0)), cv2.IMREAD_COLOR)
        left, right = view[150, 100].astype(int), view[150, 300].astype(int)
        green, meadow = (left, right) if east else (right, left)
        assert green == pytest.approx((60, 150, 40), abs=6)
        assert meadow.min() > 120


def test_a_region_lies_on_the_picture_drifts_and_the_light_changes(tmp_path):
    photo = load_orthophoto(with_world_file(tmp_path, "a.png", ".pgw", degrees_affine()))
    (patch,) = load_patches(saved(tmp_path, polygon(SQUARE)))
    spec = WorldSpec(
        HOME, 0.0, (patch,), drift_speed_m_s=0.5, drift_toward_deg=90.0, orthophoto=photo
    )
    world = World(spec)

    def gray_at(east_m, t_s):
        shot = Shot(east_m, 10.0, 9.9, CAMERA.attitude(0.0, 0.0, 0.0), t_s, 0)
        view = decoded(render(world, CAMERA, shot), cv2.IMREAD_COLOR)
        middle = view[140:160, 190:210].reshape(-1, 3).mean(axis=0)
        return abs(middle[0] - middle[1]) < 30.0  # the region is gray, the picture green

    assert gray_at(10.0, 0.0)
    assert not gray_at(-2.0, 0.0)
    assert not gray_at(10.0, 40.0)
    assert gray_at(30.0, 40.0)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({1024: 1, 3072: 32767}, "not in EPSG:4326; give its EPSG"),
        ({1024: 1, 3072: 999}, "EPSG:999"),
    ],
)
def test_geotiffs_without_a_known_system_are_refused(tmp_path, keys, message):
    path = geotiff(tmp_path, utm_affine(), keys)
    with pytest.raises(WorldError, match=message):
        load_orthophoto(path)
    if "give" in message:  # an option gives a value that the file lacks
        assert load_orthophoto(path, ZONE.epsg).epsg == ZONE.epsg


def test_pictures_that_are_no_ground_are_refused(tmp_path):
    path = tmp_path / "a.png"
    picture().save(path)
    with pytest.raises(WorldError, match=r"no a\.pgw or \.wld"):
        load_orthophoto(path)
    for text, message in (
        ("1 2 3", "six numbers"),
        ("a b c d e f", "six numbers"),
        ("nan 0 0 1 0 0", "finite"),
        ("0 0 0 0 11 48", "no extent"),
    ):
        path.with_suffix(".pgw").write_text(text)
        with pytest.raises(WorldError, match=message):
            load_orthophoto(path)
    path.with_suffix(".pgw").write_text("0.25 0 0 -0.25 700000 5320000")
    with pytest.raises(WorldError, match="not in EPSG:4326; give its EPSG code"):
        load_orthophoto(path)
    with pytest.raises(WorldError, match="EPSG:1 is not"):
        load_orthophoto(path, 1)
    with pytest.raises(WorldError, match="km from home"):
        load_ground([path], 32601, HOME)
    Image.fromarray(np.zeros((40, 40), np.uint16)).save(path)
    with pytest.raises(WorldError, match="8 bits a channel"):
        load_orthophoto(path, ZONE.epsg)
    picture().save(path)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(WorldError, match="not a readable picture"):
        load_orthophoto(path, ZONE.epsg)
    good = with_world_file(tmp_path, "b.png", ".pgw", degrees_affine())
    with pytest.raises(WorldError, match="not two"):
        load_ground([good, good])
