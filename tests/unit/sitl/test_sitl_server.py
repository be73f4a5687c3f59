"""What the server refuses, and pictures over HTTP."""

from __future__ import annotations

import asyncio

import pytest

from missions.units import LatLon
from sitl.sockets.server import PictureServer, serve
from sitl.vehicle import SimVehicle, VehicleSpec
from sitl.world.world import World, WorldSpec

HOME = LatLon(48.0, 11.0)


async def get(port, path, extra=""):
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(f"GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n{extra}\r\n".encode())
    data = await asyncio.wait_for(reader.read(), 10.0)
    writer.close()
    head, _, body = data.partition(b"\r\n\r\n")
    return head.split(b"\r\n")[0].decode(), body


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
            assert (await get(port, "/b"))[0] == "HTTP/1.1 404 Not Found"
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
