"""A plain client and a small world for the simulator's tests."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from sitl.camera.pinhole import CameraSpec
from sitl.vehicle import SimVehicle, VehicleSpec
from sitl.world.world import Patch, World, WorldSpec

ORIGIN = LatLon(37.2, -80.4)
CAMERA = CameraSpec(hfov_deg=90.0, width_px=400, height_px=300)  # focal length 200 px
LENS_M = 0.1
PATIENCE = 16  # requests without an answer


def plain_vehicle(system_id=1, world=None, **spec):
    """Return a vehicle with nothing to see below it, just switched on."""
    return SimVehicle(
        VehicleSpec(system_id, ORIGIN, **spec), world or World(WorldSpec(ORIGIN, 600.0, ()))
    )


def decoded(jpeg, flags=cv2.IMREAD_GRAYSCALE):
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), flags)
    assert picture is not None
    return np.asarray(picture, dtype=np.uint8)


class Client:
    """A client of a vehicle in bytes, which keeps every message with its time of arrival."""

    def __init__(self, vehicle):
        self.vehicle = vehicle
        self.log = []
        self._read = 0
        self._out = mav.MAVLink(None, srcSystem=255, srcComponent=190)
        self._in = mav.MAVLink(None)
        self._in.robust_parsing = True

    def _note(self, data):
        messages = self._in.parse_buffer(data) or []
        self.log += [(self.vehicle.t_s, m) for m in messages]
        return messages

    def send(self, message):
        data = message.pack(self._out)
        self._out.seq = (self._out.seq + 1) % 256
        return self._note(self.vehicle.receive(data))

    def command(self, command, *p, system=1, component=1):
        p = (*p, *([0.0] * (7 - len(p))))
        return self.send(mav.MAVLink_command_long_message(system, component, command, 0, *p))

    def result(self, command, *p, **where):
        acks = [m for m in self.command(command, *p, **where) if m.get_type() == "COMMAND_ACK"]
        assert len(acks) == 1
        assert acks[0].command == command
        return int(acks[0].result)

    def reposition(self, east_m, north_m, altitude_m, frame=6, flags=0):
        place = self.vehicle.world.plane.to_wgs84(east_m, north_m)
        message = mav.MAVLink_command_int_message(
            1, 1, frame, mav.MAV_CMD_DO_REPOSITION, 0, 0, -1.0, flags, 0.0, math.nan,
            round(place.lat_deg * 1e7), round(place.lon_deg * 1e7), altitude_m,
        )  # fmt: skip
        return int(next(m for m in self.send(message) if m.get_type() == "COMMAND_ACK").result)

    def target(self, east_m, north_m, height_m):
        return self._setpoint(0xDF8, (east_m, north_m), height_m)

    def along(self, place, velocity, height_m=12.0):
        return self._setpoint(0xDC0, place, height_m, velocity)

    def velocity(self, east_m_s, north_m_s):
        return self._setpoint(0xDC7, velocity=(east_m_s, north_m_s))

    def _setpoint(self, mask, place=None, height_m=0.0, velocity=(0.0, 0.0)):
        at = LatLon(0.0, 0.0) if place is None else self.vehicle.world.plane.to_wgs84(*place)
        return self.send(
            mav.MAVLink_set_position_target_global_int_message(
                0, 1, 1, 6, mask, round(at.lat_deg * 1e7), round(at.lon_deg * 1e7), height_m,
                velocity[1], velocity[0], *([0.0] * 6),
            )
        )  # fmt: skip

    def upload(self, rows, kind=0):
        """Send a list of (command, frame, parameters, place in metres or None, height)."""
        items = []
        for seq, (command, frame, p, place, z) in enumerate(rows):
            x, y = int(command == mav.MAV_CMD_DO_DIGICAM_CONTROL), 0  # which shoots with a 1
            if place is not None:
                at = self.vehicle.world.plane.to_wgs84(*place)
                x, y = round(at.lat_deg * 1e7), round(at.lon_deg * 1e7)
            p = (*p, *([0.0] * (4 - len(p))))
            items.append(
                mav.MAVLink_mission_item_int_message(
                    1, 1, seq, frame, command, 0, 1, *p, x, y, z, kind
                )
            )
        assert self.transfer(items, kind) == mav.MAV_MISSION_ACCEPTED

    def unread(self, kinds, seconds):
        """Return the next unread message of some kinds; None if none comes in time."""
        for _ in range(round(seconds / 0.05) + 1):
            while self._read < len(self.log):
                message = self.log[self._read][1]
                self._read += 1
                if message.get_type() in kinds:
                    return message
            self.run(0.05)
        return None

    def transfer(self, items, kind=0):
        """Upload a mission as ground stations do; return the result, None without an answer."""
        self._read, silent = len(self.log), 0
        last = mav.MAVLink_mission_count_message(1, 1, len(items), kind)
        self.send(last)
        while silent < PATIENCE:
            m = self.unread(("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"), 1.0)
            if m is None:
                silent += 1
            elif m.get_type() != "MISSION_ACK":
                silent, last = 0, items[m.seq]
            elif m.type == mav.MAV_MISSION_INVALID_SEQUENCE:
                continue  # to a second copy; it continues to ask
            else:
                return int(m.type)
            self.send(last)
        return None

    def fetch(self, kind=0, exact=True):
        """Return a list of items; None if the client knows that some are missing."""
        self._read = len(self.log)
        count = self._ask(mav.MAVLink_mission_request_list_message(1, 1, kind), "MISSION_COUNT")
        item, build = "MISSION_ITEM_INT", mav.MAVLink_mission_request_int_message
        if not exact:
            item, build = "MISSION_ITEM", mav.MAVLink_mission_request_message
        items = []
        for seq in range(0 if count is None else count.count):
            items.append(self._ask(build(1, 1, seq, kind), item, seq))
            if items[-1] is None:
                return None
        if items:
            self.send(mav.MAVLink_mission_ack_message(1, 1, mav.MAV_MISSION_ACCEPTED, kind))
        return None if count is None else items

    def _ask(self, request, kind, seq=None):
        for _ in range(PATIENCE):
            self.send(request)
            while (m := self.unread((kind,), 0.5)) is not None:
                if seq in (None, getattr(m, "seq", None)):
                    return m
        return None

    def every(self, message_id, interval_s):
        return self.result(mav.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, interval_s * 1e6)

    def run(self, seconds, watch=None):
        begin = len(self.log)
        for _ in range(round(seconds / 0.05)):
            self._note(self.vehicle.step(0.05))
            if watch is not None:
                watch()
        return [m for _, m in self.log[begin:]]

    def watch(self, seconds):
        """Return its place and its truth after each step."""
        seen = []
        self.run(seconds, lambda: seen.append((self.where, self.vehicle.truth)))
        return seen

    def put(self, **values):
        """Set parameters."""
        for name, value in values.items():
            answer = self.send(mav.MAVLink_param_set_message(1, 1, name.encode(), value, 9))
            assert answer[0].get_type() == "PARAM_VALUE", name

    @property
    def texts(self):
        return [m.text for m in self.seen("STATUSTEXT")]

    def seen(self, kind, component=None):
        return [
            m
            for _, m in self.log
            if m.get_type() == kind and component in (None, m.get_srcComponent())
        ]

    @property
    def where(self):
        truth = self.vehicle.truth
        return (*self.vehicle.world.plane.to_plane(truth.position), truth.height_m)

    def take_off(self, height_m=12.0):
        self.run(max(0.0, 6.0 - self.vehicle.t_s))
        assert self.result(mav.MAV_CMD_DO_SET_MODE, 1, 4) == 0
        assert self.result(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0
        assert self.result(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == 0
        self.run(4.0 + height_m / 2.0 + 3.0)


def speed_m_s(truth):
    """Return the speed over ground."""
    return math.hypot(*truth.velocity_m_s[:2])


@pytest.fixture
def make_client():
    """Return a maker of clients of fresh vehicles: `make_client(world={...}, **vehicle)`."""

    def make(world=None, **vehicle):
        settings = {"patches": (), "seed": 7, **(world or {})}
        spec = WorldSpec(ORIGIN, 600.0, **settings)
        vehicle = {"system_id": 1, "home": ORIGIN, "gps_sigma_m": 0.0, **vehicle}
        return Client(SimVehicle(VehicleSpec(**vehicle), World(spec)))

    return make


@pytest.fixture
def ready(make_client):
    """Return the client of a vehicle that has found its position."""
    client = make_client()
    client.run(6.0)
    return client


@pytest.fixture
def flying(make_client):
    """Return the client of a vehicle that hovers at 12 m, in GUIDED."""
    client = make_client()
    client.take_off()
    return client


@pytest.fixture
def square():
    """Return a ROI of 20 m by 20 m, its south-west corner at the origin."""
    plane = World(WorldSpec(ORIGIN, 600.0, ())).plane
    return Patch(tuple(plane.to_wgs84(e, n) for e, n in ((0, 0), (20, 0), (20, 20), (0, 20))))
