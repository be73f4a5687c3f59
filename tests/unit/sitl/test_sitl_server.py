"""The vehicles on real loopback sockets, with a plain client in the same process."""

from __future__ import annotations

import asyncio
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.units import LatLon
from sitl.camera.http import PictureServer
from sitl.sockets.server import serve
from sitl.vehicle import SimVehicle, VehicleSpec
from sitl.world.world import World, WorldSpec

HOME = LatLon(48.0, 11.0)


def free_port(kind):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Listener(asyncio.DatagramProtocol):
    """Hears a vehicle and hands out its messages."""

    def __init__(self):
        self.messages = asyncio.Queue()
        self.peer = None
        self.link = mav.MAVLink(None, srcSystem=255, srcComponent=190)

    def connection_made(self, transport):
        self.transport = transport

    def datagram_received(self, data, addr):
        self.peer = addr
        for message in self.link.parse_buffer(data) or []:
            self.messages.put_nowait(message)

    async def wait(self, kind):
        async with asyncio.timeout(10.0):
            while True:
                message = await self.messages.get()
                if message.get_type() == kind:
                    return message

    def command(self, command, *p):
        p = (*p, *([0.0] * (7 - len(p))))
        message = mav.MAVLink_command_long_message(1, 1, command, 0, *p)
        self.transport.sendto(message.pack(self.link), self.peer)


async def get(port, path, extra=""):
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(f"GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n{extra}\r\n".encode())
    data = await asyncio.wait_for(reader.read(), 10.0)
    writer.close()
    head, _, body = data.partition(b"\r\n\r\n")
    return head.split(b"\r\n")[0].decode(), body


def test_a_client_flies_it_over_sockets():
    async def scenario():
        http = free_port(socket.SOCK_STREAM)
        udp = free_port(socket.SOCK_DGRAM)
        world = World(WorldSpec(HOME, 500.0, ()))
        prefix = f"http://127.0.0.1:{http}/"
        vehicle = SimVehicle(VehicleSpec(1, HOME, image_url_prefix=prefix), world)
        loop = asyncio.get_running_loop()
        transport, listener = await loop.create_datagram_endpoint(
            Listener, local_addr=("127.0.0.1", udp)
        )
        ready = loop.create_future()
        serving = asyncio.create_task(
            serve([vehicle], speedup=50.0, base_port=udp, http_port=http, on_ready=ready.set_result)
        )
        try:
            assert await asyncio.wait_for(ready, 10.0) == [f"udpin://127.0.0.1:{udp}"]
            heartbeat = await listener.wait("HEARTBEAT")
            assert heartbeat.autopilot == mav.MAV_AUTOPILOT_ARDUPILOTMEGA
            await listener.wait("HOME_POSITION")
            listener.command(mav.MAV_CMD_DO_SET_MODE, 1, 4)
            assert (await listener.wait("COMMAND_ACK")).result in (0, 4)
            while True:
                listener.command(mav.MAV_CMD_DO_SET_MODE, 1, 4)
                if (await listener.wait("COMMAND_ACK")).result == 0:
                    break
            listener.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            assert (await listener.wait("COMMAND_ACK")).result == 0
            listener.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 5)
            assert (await listener.wait("COMMAND_ACK")).result == 0
            listener.command(mav.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1, 1)
            captured = await listener.wait("CAMERA_IMAGE_CAPTURED")
            path = captured.file_url.removeprefix(f"http://127.0.0.1:{http}")
            status, body = await get(http, path)
            assert status == "HTTP/1.1 200 OK"
            assert body == vehicle.image(captured.file_url)
            assert (await get(http, "/1/99.jpg"))[0] == "HTTP/1.1 404 Not Found"
            async with asyncio.timeout(10.0):
                while vehicle.truth.height_m < 4.0:
                    await listener.wait("HEARTBEAT")
        finally:
            serving.cancel()
            await asyncio.gather(serving, return_exceptions=True)
            transport.close()
        # every socket is closed: the ports can be taken again
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as again:
            again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            again.bind(("127.0.0.1", http))

    asyncio.run(scenario())


@pytest.mark.parametrize("speedup", [0.0, -1.0, float("nan")])
def test_impossible_speedups_are_refused(speedup):
    vehicle = SimVehicle(VehicleSpec(1, HOME), World(WorldSpec(HOME, 0.0, ())))
    with pytest.raises(ValueError, match="speed-up"):
        asyncio.run(serve([vehicle], speedup=speedup, http_port=1, on_ready=print))


def test_pictures_must_be_announced_where_they_are_served():
    vehicle = SimVehicle(VehicleSpec(1, HOME), World(WorldSpec(HOME, 0.0, ())))
    with pytest.raises(ValueError, match="announces them at sim://"):
        asyncio.run(serve([vehicle], http_port=8123, on_ready=print))


def test_http_that_is_none():
    async def scenario():
        server = PictureServer(lambda path: b"picture" if path == "/a" else None)
        port = await server.open(0)
        try:
            assert await get(port, "/a?x=1") == ("HTTP/1.1 200 OK", b"picture")
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(b"POST /a HTTP/1.1\r\nContent-Length: 3\r\n\r\nabc")
            assert (await reader.readline()).startswith(b"HTTP/1.1 405")
            writer.close()
            for nonsense in (b"\xfd\x00\r\n\r\n", b"GET\r\n\r\n", b"x" * 40_000):
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.write(nonsense)
                answer = await asyncio.wait_for(reader.read(), 10.0)
                assert answer == b"" or answer.startswith(b"HTTP/1.1 400")
                writer.close()
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            for _ in range(2):  # the same connection again
                writer.write(b"GET /a HTTP/1.1\r\n\r\n")
                head = await reader.readuntil(b"\r\n\r\n")
                assert b"keep-alive" in head
                assert await reader.readexactly(7) == b"picture"
            writer.close()
        finally:
            await server.close()

    asyncio.run(scenario())
