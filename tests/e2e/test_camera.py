"""`uavmap camera` and `uavmap fly --camera` as processes, against `uavmap sitl`."""

from __future__ import annotations

import contextlib
import signal
import socket
import threading
import time
import urllib.request
from collections.abc import Iterator

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.e2e.rig import (
    LOOPBACK,
    PATIENCE_S,
    Relay,
    ended,
    events,
    free_ports,
    mission,
    simulator,
    started,
    uavmap,
    wait_until,
)
from tests.unit.uavmap.cameras.test_captures import SIZE_PX, mjpeg


class Router:
    """Between an aircraft without a camera of its own, `uavmap camera`, and a ground station."""

    def __init__(self, aircraft_port: int, camera_port: int) -> None:
        self._aircraft = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._aircraft.bind((LOOPBACK, aircraft_port))
        self._camera = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._camera.bind((LOOPBACK, 0))
        for end in (self._aircraft, self._camera):
            end.settimeout(0.01)
        self._to = (LOOPBACK, camera_port)
        self._from: tuple[str, int] | None = None
        self._down, self._up = mav.MAVLink(None), mav.MAVLink(None)
        self._ground = mav.MAVLink(None, 255, 190)
        self.place: mav.MAVLink_global_position_int_message | None = None

    def close(self) -> None:
        self._aircraft.close()
        self._camera.close()

    def send(self, command: int, *params: float) -> None:
        filled = (*params, *([0.0] * (7 - len(params))))
        message = mav.MAVLink_command_long_message(1, 100, command, 0, *filled)
        self._camera.sendto(message.pack(self._ground), self._to)

    def step(self) -> list:
        """Pass on what there is; what the camera has said."""
        with contextlib.suppress(TimeoutError, ConnectionError):
            data, self._from = self._aircraft.recvfrom(4096)
            for message in self._down.parse_buffer(data) or ():
                if message.get_srcComponent() == 1:
                    self._camera.sendto(bytes(message.get_msgbuf()), self._to)
                if message.get_type() == "GLOBAL_POSITION_INT":
                    self.place = message
        with contextlib.suppress(TimeoutError, ConnectionError):
            data, _ = self._camera.recvfrom(4096)
            said = list(self._up.parse_buffer(data) or ())
            for message in said:
                if getattr(message, "target_component", 0) == 1 and self._from is not None:
                    self._aircraft.sendto(bytes(message.get_msgbuf()), self._from)
            return said
        return []

    def expect(self, kind: str, **fields: object):
        due_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < due_s:
            for message in self.step():
                if message.get_type() == kind and all(
                    getattr(message, name) == value for name, value in fields.items()
                ):
                    return message
        raise AssertionError(f"no {kind} {fields}")


@pytest.fixture
def router() -> Iterator[tuple[Router, int]]:
    with simulator("speck", speedup=1.0) as (url,):
        camera_port, _ = free_ports(1)
        made = Router(int(url.rpartition(":")[2]), camera_port)
        yield made, camera_port
        made.close()


def test_a_stream_is_a_mavlink_camera_of_the_aircraft(router: tuple[Router, int]) -> None:
    ground, camera_port = router
    _, http_port = free_ports(1)
    accepted, busy = mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_TEMPORARILY_REJECTED
    with mjpeg() as video_port:
        arguments = ["--connect", f"udpin://{LOOPBACK}:{camera_port}"]
        arguments += ["--source", f"http://{LOOPBACK}:{video_port}/video", "--size", "320x240"]
        arguments += ["--serve", f"{LOOPBACK}:{http_port}"]
        with started("camera", *arguments) as process:
            beat = ground.expect("HEARTBEAT", type=mav.MAV_TYPE_CAMERA)
            assert (beat.get_srcSystem(), beat.get_srcComponent()) == (1, 100)
            ground.send(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_CAMERA_INFORMATION)
            facts = ground.expect("CAMERA_INFORMATION")
            assert (facts.resolution_h, facts.resolution_v) == SIZE_PX
            wait_until(lambda: [ground.step(), ground.place][1] is not None, "the position")
            ground.send(mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 0.5, 0)
            ack = ground.expect("COMMAND_ACK", command=mav.MAV_CMD_IMAGE_START_CAPTURE)
            assert (ack.result, ack.target_system) == (accepted, 255)
            ground.send(mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 0.5, 0)
            ground.expect("COMMAND_ACK", result=busy)
            first = ground.expect("CAMERA_IMAGE_CAPTURED", image_index=0)
            second = ground.expect("CAMERA_IMAGE_CAPTURED", image_index=1)
            # (how far apart is the unit tests': where the machine is busy the first may be late)
            assert first.time_boot_ms < second.time_boot_ms
            assert ground.place is not None
            assert abs(second.lat - ground.place.lat) < 500  # 5 m
            assert abs(second.relative_alt - ground.place.relative_alt) < 2000
            assert sum(x * x for x in second.q) == pytest.approx(1.0, abs=1e-3)
            assert abs(ground.place.time_boot_ms - second.time_boot_ms) < 3000
            with urllib.request.urlopen(second.file_url, timeout=PATIENCE_S) as answer:
                assert answer.read()[:3] == b"\xff\xd8\xff"
            ground.send(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED, 0)
            assert ground.expect("CAMERA_IMAGE_CAPTURED", image_index=0).file_url == first.file_url
            ground.send(mav.MAV_CMD_IMAGE_STOP_CAPTURE)
            ground.expect("COMMAND_ACK", command=mav.MAV_CMD_IMAGE_STOP_CAPTURE, result=accepted)
            ground.send(mav.MAV_CMD_DO_JUMP)
            ground.expect("COMMAND_ACK", result=mav.MAV_RESULT_UNSUPPORTED)
            process.send_signal(signal.SIGINT)
            done = ended(process)
    assert done.code == 0
    assert "part of aircraft 1: a camera" in done.err


class CardCamera(threading.Thread):
    """Has the simulated camera take pictures all the time and writes them into a folder."""

    def __init__(self, vehicle: tuple[str, int], folder) -> None:
        super().__init__()
        self._link = mavutil.mavlink_connection(
            f"udpout:{vehicle[0]}:{vehicle[1]}", source_system=254
        )
        self._folder = folder
        self.over = threading.Event()

    def run(self) -> None:
        asked_s = 0.0
        while not self.over.is_set():
            if time.monotonic() - asked_s > 1.0:
                asked_s = time.monotonic()
                self._link.mav.command_long_send(
                    1, 100, mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1.0, 0, 0, 0, 0, 0
                )
            message = self._link.recv_match(type="CAMERA_IMAGE_CAPTURED", timeout=0.05)
            if message is None:
                time.sleep(0.005)
                continue
            with contextlib.suppress(OSError), urllib.request.urlopen(message.file_url) as answer:
                hidden = self._folder / f".{message.image_index}.part"
                hidden.write_bytes(answer.read())
                hidden.rename(self._folder / f"DSC{message.image_index:05}.JPG")
        self._link.close()


def test_a_flight_with_the_pictures_of_a_folder(tmp_path) -> None:
    """Until some are judged; whole flights are flown on virtual time."""
    card, folder = tmp_path / "card", tmp_path / "out"
    card.mkdir()
    with (
        simulator("speck", speedup=4.0) as (url,),
        Relay(int(url.rpartition(":")[2])) as relay,
        started(
            *("fly", mission("speck"), "--connect", relay.url, "--camera", f"folder:{card}"),
            *("--speedup", 4, "--out", folder, "--json"),
        ) as process,
    ):
        wait_until(lambda: relay.vehicle is not None, "the aircraft")
        assert relay.vehicle is not None
        camera = CardCamera(relay.vehicle, card)
        camera.start()
        try:
            wait_until(
                lambda: len(events(folder, "frame_seen")) >= 3 or process.poll() is not None,
                "judged frames",
            )
        finally:
            camera.over.set()
            camera.join()
        assert process.poll() is None, process.communicate()
        for _ in range(2):
            process.send_signal(signal.SIGINT)
            time.sleep(0.2)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ["--connect", "udpin://127.0.0.1:14999", "--camera", "usb"],
            "'usb' is not a camera; write mavlink, v4l2:/dev/video0",
        ),
        (["--sim", "--camera", "libcamera"], "--camera goes with --connect"),
        (
            ["--connect", "udpin://127.0.0.1:0", "--camera", "mavlink", "--camera", "mavlink"],
            "1 vehicles, but 2 cameras; give --camera once a vehicle",
        ),
    ],
)
def test_what_is_wrong_with_a_camera_is_said_in_a_line(arguments, line, tmp_path) -> None:
    done = uavmap("fly", mission("speck"), *arguments, "--out", tmp_path / "out")
    assert done.code == 2
    assert line in done.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--source", "folder:/no/such"], "/no/such: no such folder"),
        (["--source", "mavlink"], "mavlink: is a camera of the autopilot already"),
        (["--source", "libcamera", "--serve", "0.0.0.0:81"], "pictures cannot be fetched from"),
        (["--source", "libcamera", "--size", "big"], "--size big is not WIDTHxHEIGHT"),
    ],
)
def test_what_is_wrong_with_a_camera_command_is_said_in_a_line(arguments, line) -> None:
    done = uavmap("camera", "--connect", "udpin://127.0.0.1:14998", *arguments)
    assert done.code == 2
    assert line in done.err
