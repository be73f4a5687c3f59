"""The doors of the program, each with examples that the product or its simulator has written."""

from __future__ import annotations

import contextlib
import io
import json
import math
import zipfile
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np
from PIL import Image

from missions.events import Event, from_json, to_json
from missions.fleet_events import Fact, Part
from missions.flight.setting_of import setting_of
from missions.flight.step import step
from missions.mission.checks import parse_mission
from missions.orders import TakeOff
from missions.units import Cell, GridPoint, LatLon, PadHeight, Pose, Quaternion
from sitl.vehicle import SimVehicle, VehicleSpec
from sitl.world.world import World, WorldSpec
from tests.fuzz.engine import Target
from tests.support.areas.area_files import SAMPLES
from tests.support.fleet_rig import field_text
from tests.support.journals import some_events, write
from tests.support.mavlink_peer import Peer, ack, heartbeat, position, text
from tests.support.photographs import write_photo
from uavmap.aircraft.process import messages as process
from uavmap.base.clock import VirtualClock, run
from uavmap.fleet.codec import AirRequest, Batch, Message, OperatorOrder, Presence, decode, encode
from uavmap.fleet.knowledge import Holding
from uavmap.fleet.member import Member
from uavmap.fleet.radio import Radios
from uavmap.fleet.sealing import Seal
from uavmap.journal.event_log import JournalReader, Position
from uavmap.load.areas.reading import read_area_file
from uavmap.load.areas.zone_files import read_zones
from uavmap.load.detector_source import detector_text
from uavmap.load.map_tiles import Bounds, fetch, tiles_in
from uavmap.load.mission_source import load, prior_places
from uavmap.mavlink.links.framing import Splitter, length_of
from uavmap.mavlink.session import Session
from uavmap.photos.registration.calibration import read_calibration
from uavmap.photos.sources.photo_file import decoded, read_photo
from uavmap.photos.sources.photo_folder import read_geo_file
from uavmap.photos.sources.picture_record import Picture, credible
from uavmap.photos.sources.video import read_srt, read_tlog
from uavmap.ui.ground.layer import open_layer
from uavmap.ui.page.access_guard import Guard
from uavmap.ui.page.live_geojson import part_of
from uavmap.ui.page.page_pipe import MAP_PATH, Lines

HOME: Final = LatLon(47.1, 8.3)
DATA: Final = Path(__file__).parents[1] / "data"


def put(folder: Path, name: str, data: bytes) -> Path:
    (folder / name).write_bytes(data)
    return folder / name


def chosen(names: tuple[str, ...], data: bytes) -> tuple[str, bytes]:
    """Return the kind of file that the first byte chooses, and the content."""
    return names[data[0] % len(names)] if data else names[0], data[1:]


# --- MAVLink --------------------------------------------------------------------------------------
def frames(folder: Path) -> list[bytes]:
    vehicle, peer = SimVehicle(VehicleSpec(1, HOME), World(WorldSpec(HOME, 600.0, ()))), Peer()
    said = [vehicle.step(0.1) for _ in range(60)]
    said += [peer.frame(m) for m in (heartbeat(), position(HOME, t_s=3.0), ack(400, 0), text("a"))]
    return [b for b in said if b] + [b"".join(said)[:8000]]


FIRST: Final = Peer().frame(heartbeat()) + Peer().frame(position(HOME, t_s=1.0))


def mavlink(data: bytes, folder: Path) -> None:
    """A session keeps no impossible place, and every frame is as long as it states."""

    async def feed() -> Session:
        session = Session(lambda frame: None, lambda frame: None)
        for part in (FIRST, data[: len(data) // 2], data[len(data) // 2 :]):
            session.feed(part)
        return session

    view = run(feed(), VirtualClock()).view
    places = [place for place in (view.position, view.home) if place is not None]
    assert all(abs(p.lat_deg) <= 90.0 and abs(p.lon_deg) <= 180.0 for p in places)
    assert all(math.isfinite(n) for n in (view.height_m, view.volts, view.hdop) if n is not None)
    assert all(length_of(frame) == len(frame) for frame in Splitter().feed(data))


def photographs(folder: Path) -> list[bytes]:
    found = [write_photo(folder / "a.jpg").read_bytes()]
    for kind, mode in (("PNG", "RGBA"), ("TIFF", "I;16"), ("TIFF", "RGB"), ("PNG", "P")):
        out = io.BytesIO()
        image = Image.fromarray(np.arange(192, dtype=np.uint8).reshape(8, 8, 3))
        shown = Image.new(mode, (8, 8)) if mode == "I;16" else image.convert(mode)
        shown.save(out, kind)
        found.append(out.getvalue())
    return found


def photograph(data: bytes, folder: Path) -> None:
    read = read_photo(put(folder, "a.jpg", data), "a.jpg")
    if isinstance(read, Picture):
        assert read.position is None or abs(read.position.lat_deg) <= 90.0
        credible([read])
    assert min(decoded(data, 64).shape[:2]) > 0


RECORDS: Final = (".srt", ".tlog", ".txt", ".cal")


def records(folder: Path) -> list[bytes]:
    stamp = (1_700_000_000_000_000).to_bytes(8, "big")
    log = b"".join(stamp + Peer().frame(position(HOME, t_s=float(k))) for k in range(3))
    srt = (
        "1\n00:00:00,000 --> 00:00:00,033\n[latitude: 47.1] [longitude: 8.3] "
        "[rel_alt: 30.0 abs_alt: 530.0] [gb_yaw: 12.0 gb_pitch: -90.0 gb_roll: 0.0]\n"
    )
    geo = "EPSG:4326\na.jpg 8.3 47.1 530 12 -90 0 0.1 0.2\n"
    lens = {"camera_matrix": [[900, 0, 640], [0, 900, 360], [0, 0, 1]], "image_size": [1280, 720],
            "distortion_coefficients": [0.1, 0, 0, 0]}  # fmt: skip
    yaml = (
        "%YAML:1.0\n---\nimage_width: 1280\nimage_height: 720\ncamera_matrix: !!opencv-matrix\n"
        "   rows: 3\n   cols: 3\n   dt: d\n   data: [ 900, 0., 640., 0., 900., 360., 0., 0., 1. ]\n"
    )
    texts = srt, geo, json.dumps(lens), yaml
    return [b"\1" + log, *(b"\0\2\3\3"[k : k + 1] + t.encode() for k, t in enumerate(texts))]


def record(data: bytes, folder: Path) -> None:
    kind, content = chosen(RECORDS, data)
    path = put(folder, f"a{kind}", content)
    if kind in (".txt", ".cal"):
        (read_geo_file if kind == ".txt" else read_calibration)(path)
        return
    for moment in (read_srt if kind == ".srt" else read_tlog)(path):
        assert moment.position is None or abs(moment.position.lat_deg) <= 90.0


# --- missions and areas ---------------------------------------------------------------------------
def mission_files(folder: Path) -> list[bytes]:
    shipped = (resources.files("missions") / "shipped").iterdir()
    return [f.read_bytes() for f in shipped if f.name.endswith(".toml")] + [field_text().encode()]


def mission(data: bytes, folder: Path) -> None:
    made = load(str(put(folder, "a.toml", data)))
    setting_of(made)


AREAS: Final = (
    ".kml", ".gpx", ".geojson", ".kmz", ".zip", ".shp", ".gpkg", ".plan", ".waypoints", ".poly",
    ".fen", ".csv", ".zones", ".prior", ".doc.kml", ".in.zip",
)  # fmt: skip


def areas(folder: Path) -> list[bytes]:
    kinds = {kind: bytes([k]) for k, kind in enumerate(AREAS)}
    files = [path for path in SAMPLES.rglob("*") if path.suffix.lower() in kinds]
    found = [kinds[p.suffix.lower()] + p.read_bytes() for p in sorted(files)]
    small = [data for data in found if len(data) < 20_000]
    kml = next(p.read_bytes() for p in files if p.suffix == ".kml")
    shp = next(p.read_bytes() for p in files if p.suffix == ".shp")
    drawn = next(p.read_bytes() for p in files if p.suffix == ".geojson")
    for kind, data in ((".doc.kml", kml), (".in.zip", shp), (".zones", drawn), (".prior", drawn)):
        small.append(kinds[kind] + data)
    return small


def area(data: bytes, folder: Path) -> None:
    """Positions of a drawing are on earth."""
    kind, content = chosen(AREAS, data)
    if kind in (".doc.kml", ".in.zip"):  # damage inside of an archive that is whole
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("doc.kml" if kind == ".doc.kml" else "a.shp", content)
        kind, content = ".zip", out.getvalue()
    path = put(folder, f"a{kind}", content)
    if kind == ".zones":
        read_zones(path, "zones")
    elif kind == ".prior":
        prior_places(path, "prior")
    else:
        drawing = read_area_file(str(path))
        for one in (*drawing.areas, *drawing.fences):
            assert len(one.ring) >= 3
            assert all(abs(p.lat_deg) <= 90.0 and abs(p.lon_deg) <= 180.0 for p in one.ring)


# --- journals, fleets, processes ------------------------------------------------------------------
def journals(folder: Path) -> list[bytes]:
    whole = write(folder / "journal" / "a.jsonl", some_events(4)).read_bytes()
    events = b"\n".join(to_json(event).encode() for event in some_events(2))
    return [b"\0" + whole, b"\1" + events]


def journal(data: bytes, folder: Path) -> None:
    """Events are those that were sealed; of sealed garbage, those that can be written again."""
    kind, content = chosen(("raw", "sealed"), data)
    if kind == "sealed":
        opening = b'{"format":1,"planner":"plain","meta":{}}'
        content, at = Position().sealed("journal", opening)
        for text in data[1:].split(b"\n"):
            line, at = at.sealed("event", text)
            content += line
    for event in JournalReader(put(folder, "a.jsonl", content)).events():
        assert from_json(to_json(event)) == event


KEY: Final = bytes(range(32))
FLEET: Final = setting_of(parse_mission(field_text(), "fleet"), 1)


def datagrams(folder: Path) -> list[bytes]:
    fact = Fact(2.0, ((Cell(0, 0), True), (Cell(1, 0), False)))
    here = Presence("flies", GridPoint(3.0, -4.5), 12.0, 0.8, 12.0, (1,), (GridPoint(9.0, 9.0),))
    said = (
        Message(12.5, here, {1: Holding(7, ((9, 12),))}, begun=True),
        Message(12.5, here, batches=(Batch(2, 0, (fact,) * 3),), begun=True),
        Message(3.0, here, words=(OperatorOrder(7, 0, "recall"),), pad=PadHeight(500.0, 1.0)),
        Message(3.0, here, ask=AirRequest(1, GridPoint(0.0, 0.0), 1.0, 9.0, 60.0),
                promised={1: 2}, parts=(Part(1, (GridPoint(4.0, 8.0),)),), begun=True),
    )  # fmt: skip
    return [encode(message) for message in said]


def datagram(data: bytes, folder: Path) -> None:
    """Every message is decoded again as it was; each report can be written and carried out."""
    posted: list[Event] = []

    async def listen() -> None:
        seal, other = Seal(KEY, 1, 1), Seal(KEY, 2, 1)
        member = Member(FLEET, seal, Radios(), lambda: 12.0, posted.append)
        member.clock_moved(0.0)
        state = FLEET.initial_state()
        member.receive(data)
        member.receive(other.sealed(b""))
        other.opened(seal.errands()[0])
        member.receive(other.errands()[0])
        member.receive(other.sealed(data))
        for event in posted:
            to_json(event)
            state, _ = step(state, event)
            member.observe(event, state)
        member.beat()
        member.end()

    run(listen(), VirtualClock())
    with contextlib.suppress(ValueError):
        assert decode(encode(decode(data))) == decode(data)


def process_messages(folder: Path) -> list[bytes]:
    pose = Pose(HOME, 12.0, Quaternion(1.0, 0.0, 0.0, 0.0))
    said: list[process.Message] = [
        process.Attach(process.VERSION, "word"), process.GiveOrder(2, TakeOff(12.0)),
        process.Beat(12.5, fates={1: "in the air"}), process.Ready(None, 4.0, {1: HOME}),
        process.Picture(1, 1, 2.0, pose, Cell(1, 2), False, "a", (1, 2, 3), bytes(6)),
        *(process.EventReport(event) for event in some_events(1)),
    ]  # fmt: skip
    return [process.encode(message) for message in said]


def process_message(data: bytes, folder: Path) -> None:
    """A message is decoded again as it was; pixels of a picture have its shape."""
    size = int.from_bytes(data[:4], "big")
    framed = data if size < len(data) else len(data).to_bytes(4, "big") + bytes(4) + data
    for message in process.Decoder().feed(framed):
        (again,) = process.Decoder().feed(process.encode(message))
        assert repr(again) == repr(message)
        if isinstance(message, process.Picture):
            _ = message.content


COOKIE: Final = "uavmap-8470"


def requests(folder: Path) -> list[bytes]:
    lines = (
        "http\n/\ntoken=right\nhost: 127.0.0.1:8470\norigin: http://127.0.0.1:8470",
        f"http\n{MAP_PATH}\ntoken=map\nhost: 127.0.0.1:8470\nrange: bytes=1-9",
        "websocket\n/_nicegui_ws/socket.io/\n\nhost: a\ncookie: x=1; uavmap-8470=wrong",
        '{"do": "return", "vehicle": 2, "id": "7"}\n{"ready": true}',
    )
    return [line.encode() for line in lines]


def request(data: bytes, folder: Path) -> None:
    """Without a right token nothing is served."""
    Lines().parse(data + b"\n")
    kind, path, query, *rest = [*data.split(b"\n"), b"", b"", b""]
    headers = [(k.lower(), v.strip()) for k, colon, v in (h.partition(b":") for h in rest) if colon]
    type_ = "websocket" if kind == b"websocket" else "http"
    served, sent = list[Any](), list[dict[str, Any]]()

    async def app(scope: Any, receive: Any, send: Any) -> None:
        asked = dict(headers).get(b"range", b"").decode("latin-1")
        status, _, body = part_of(b"0123456789", asked)
        assert status in (200, 206, 416)
        assert body in b"0123456789"
        served.append(scope)

    async def receive() -> dict[str, Any]:
        return {"type": f"{type_}.connect"}

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    scope = {
        "type": type_, "path": path.decode("utf-8", "replace"), "query_string": query,
        "headers": headers,
    }  # fmt: skip
    run(Guard(app, "right", COOKIE, "map", "watch")(scope, receive, send), VirtualClock())
    assert not served or any(token in data for token in (b"right", b"map", b"watch"))
    assert served or sent


MODELS: Final = ("net.onnx", "net.toml", "detector.toml", "model.json")


def models(folder: Path) -> list[bytes]:
    toml = b'tile_px = 32\noutput = "probability"\nscale = 1.0\n[classes.oil]\nnumber = 2\n'
    table = b'[detector]\nname = "onnx"\nmodel = "net.onnx"\nshare = 0.5\n'
    return [b"\0" + (DATA / "mean.onnx").read_bytes(), b"\1" + toml, b"\2" + table, b"\3{}"]


def model(data: bytes, folder: Path) -> None:
    kind, content = chosen(MODELS, data)
    files = dict(zip(MODELS, (one[1:] for one in MODEL_FILES), strict=True)) | {kind: content}
    if kind == "model.json":
        files["detector.toml"] = b'[detector]\nname = "learned"\nmodel = "model.json"\n'
    for name, each in files.items():
        put(folder, name, each)
    detector_text(folder)


MODEL_FILES: Final = models(Path())
TILES: Final = (".mbtiles", ".pmtiles")


class _LocalSource:
    url, attribution = "https://a/{z}/{x}/{y}.png", "(c) a"

    def fetched(self, tile: object) -> bytes:
        out = io.BytesIO()
        Image.new("RGB", (8, 8)).save(out, "PNG")
        return out.getvalue()


def maps(folder: Path) -> list[bytes]:
    from pmtiles.tile import Compression, TileType  # noqa: PLC0415 - an extra
    from pmtiles.writer import Writer  # noqa: PLC0415

    bounds, source = Bounds.around([HOME]), _LocalSource()
    path = folder / "a.mbtiles"
    fetch(source, tiles_in(bounds, range(1, 3)), bounds, path, lambda n: None)  # type: ignore[arg-type]
    out = io.BytesIO()
    writer = Writer(out)
    writer.write_tile(0, source.fetched(None))
    writer.finalize(
        {"tile_type": TileType.PNG, "tile_compression": Compression.NONE, "center_zoom": 0,
         "center_lon_e7": 0, "center_lat_e7": 0, "min_lat_e7": 0, "max_lat_e7": 10_000_000,
         "min_lon_e7": 0, "max_lon_e7": 10_000_000},
        {"attribution": "(c) a"},
    )  # fmt: skip
    data = path.read_bytes()
    path.unlink()
    return [b"\0" + data, b"\1" + out.getvalue()]


def map_file(data: bytes, folder: Path) -> None:
    """The middle of a map is on earth, and tiles are pictures."""
    kind, content = chosen(TILES, data)
    with contextlib.closing(open_layer(put(folder, f"a{kind}", content))) as layer:
        lat_deg, lon_deg = layer.middle
        assert abs(lat_deg) <= 90.0
        assert abs(lon_deg) <= 180.0
        assert 0 <= layer.zooms[0] <= layer.zooms[-1] <= 30
        layer.tile(layer.zooms[0], 0, 0)


TARGETS: Final = {
    target.name: target
    for target in (
        Target("mavlink", frames, mavlink), Target("pictures", photographs, photograph),
        Target("records", records, record), Target("missions", mission_files, mission),
        Target("areas", areas, area), Target("journals", journals, journal),
        Target("fleet", datagrams, datagram), Target("process", process_messages, process_message),
        Target("page", requests, request), Target("models", models, model),
        Target("maps", maps, map_file),
    )
}  # fmt: skip
