from __future__ import annotations

import asyncio
import contextlib
import functools
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from sitl.codec import Packer, cut
from sitl.mavlink.links import Signing
from sitl.sockets.client_sockets import Connection, TcpPort, datagrams
from sitl.sockets.server import PictureServer, free_ports, serve
from sitl.world.world import World, WorldSpec
from tests.unit.sitl.conftest import ORIGIN, plain_vehicle

GLOBAL_POSITION_INT = mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT


def in_a_loop(test):

    @functools.wraps(test)
    def run(*given, **named):
        asyncio.run(test(*given, **named))

    return run


@contextlib.asynccontextmanager
async def served(transport, count=1, speedup=20.0):
    world = World(WorldSpec(ORIGIN, 500.0, ()))
    vehicles = [plain_vehicle(i + 1, world) for i in range(count)]
    port, _ = free_ports(count, tcp=transport == "tcp")
    ready = asyncio.get_running_loop().create_future()
    task = asyncio.create_task(
        serve(
            vehicles, speedup=speedup, transport=transport, base_port=port, http_port=None,
            on_ready=ready.set_result,
        )
    )  # fmt: skip
    try:
        await asyncio.wait_for(asyncio.wait([ready, task], return_when="FIRST_COMPLETED"), 10.0)
        yield vehicles, port, ready.result()
        assert not task.done()  # no client has ended it
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


class Udp(asyncio.DatagramProtocol):
    def __init__(self):
        self.messages = asyncio.Queue()
        self.link = mav.MAVLink(None, srcSystem=255, srcComponent=190)
        self.link.robust_parsing = True
        self.peer = None

    @classmethod
    async def open(cls, port=0):
        loop = asyncio.get_running_loop()
        _, client = await loop.create_datagram_endpoint(cls, local_addr=("127.0.0.1", port))
        return client

    def connection_made(self, transport):
        self.transport = transport

    def datagram_received(self, data, addr):
        self.peer = addr
        assert cut(data)[-1][0] == mav.PROTOCOL_MARKER_V2
        for message in self.link.parse_buffer(data) or []:
            self.messages.put_nowait(message)

    def send(self, message, to=None):
        self.transport.sendto(message.pack(self.link), to or self.peer)

    async def wait(self, kind):
        async with asyncio.timeout(10.0):
            while True:
                message = await self.messages.get()
                if message.get_type() == kind:
                    return message


class Tcp:
    @classmethod
    async def open(cls, port):
        self = cls()
        self.reader, self.writer = await asyncio.open_connection("127.0.0.1", port)
        self.link = mav.MAVLink(None, srcSystem=255, srcComponent=190)
        self.link.robust_parsing = True
        self.first = b""
        self.left = []
        return self

    def send(self, message):
        self.writer.write(message.pack(self.link))

    async def wait(self, kind):
        async with asyncio.timeout(10.0):
            while True:
                while self.left:
                    message = self.left.pop(0)
                    if message.get_type() == kind:
                        return message
                data = await self.reader.read(4096)
                if not data:
                    raise EOFError
                self.first = self.first or data
                self.left += self.link.parse_buffer(data) or []


def command(command, *p, system=1):
    p = (*p, *([0.0] * (7 - len(p))))
    return mav.MAVLink_command_long_message(system, 1, command, 0, *p)


def interval(message_id, hz, system=1):
    return command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / hz, system=system)


@in_a_loop
async def test_several_udp_clients_receive_everything():
    async with served("udp") as (vehicles, port, urls):
        assert urls == [f"udpin://127.0.0.1:{port}"]
        listener = await Udp.open(port)
        await listener.wait("HEARTBEAT")
        other = await Udp.open()
        other.send(interval(GLOBAL_POSITION_INT, 10), listener.peer)
        for client in (listener, other):  # the reply and the telemetry go to all
            assert (await client.wait("COMMAND_ACK")).result == mav.MAV_RESULT_ACCEPTED
            await client.wait("GLOBAL_POSITION_INT")
        # half a frame of one does not spoil the other's
        whole = command(mav.MAV_CMD_REQUEST_MESSAGE, 148).pack(listener.link)
        listener.transport.sendto(whole[:20], listener.peer)
        other.send(command(mav.MAV_CMD_REQUEST_MESSAGE, 242))
        await other.wait("COMMAND_ACK")
        listener.transport.sendto(whole[20:], listener.peer)
        await listener.wait("AUTOPILOT_VERSION")
        # one vanishes
        other.transport.abort()
        for _ in range(20):
            await listener.wait("GLOBAL_POSITION_INT")
        assert vehicles[0].t_s > 2.0
        listener.transport.close()


@in_a_loop
async def test_udp_clients_above_the_maximum_replace_the_oldest_but_the_first():
    async with served("udp") as (vehicles, port, _):
        listener = await Udp.open(port)
        await listener.wait("HEARTBEAT")
        others = [await Udp.open() for _ in range(12)]
        for client in others:
            client.send(command(mav.MAV_CMD_REQUEST_MESSAGE, 148), listener.peer)
            await client.wait("AUTOPILOT_VERSION")
        assert len(vehicles[0]._links) == 1 + 8
        await listener.wait("HEARTBEAT")  # the first is never forgotten
        await others[-1].wait("HEARTBEAT")
        for client in (listener, *others):
            client.transport.close()


@pytest.mark.parametrize("forgets", [False, True])
@in_a_loop
async def test_tcp_is_flown_and_serves_one_at_a_time(forgets, monkeypatch):
    """Python 3.11.2 adds the reader after a pause in `connection_made`, and loses the pause."""
    if forgets:
        monkeypatch.setattr(
            asyncio.selector_events._SelectorTransport,
            "_add_reader",
            lambda transport, file, callback: transport._loop._add_reader(file, callback),
        )

    async with served("tcp", count=2) as (vehicles, port, urls):
        assert urls == [f"tcpout://127.0.0.1:{port}", f"tcpout://127.0.0.1:{port + 10}"]
        first = await Tcp.open(port)
        await first.wait("HEARTBEAT")
        assert first.first.startswith(b"\r\n\r\nInit ArduCopter")
        second = await Tcp.open(port)
        second.send(command(mav.MAV_CMD_DO_SET_MODE, 1, 4))
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(second.reader.read(1), 0.3)
        neighbour = await Tcp.open(port + 10)
        assert (await neighbour.wait("HEARTBEAT")).get_srcSystem() == 2
        first.send(interval(GLOBAL_POSITION_INT, 10))
        await first.wait("GLOBAL_POSITION_INT")
        assert vehicles[0].truth.mode == 0
        first.writer.transport.abort()
        # its turn: its messages are received now, and the rates persist
        assert (await second.wait("COMMAND_ACK")).command == mav.MAV_CMD_DO_SET_MODE
        await second.wait("GLOBAL_POSITION_INT")
        for client in (second, neighbour):
            client.writer.close()


@in_a_loop
async def test_tcp_client_that_stops_reading_harms_no_other():
    async with served("tcp", count=2, speedup=100.0) as (vehicles, port, _):
        deaf, other = await Tcp.open(port), await Tcp.open(port + 10)
        deaf.writer.transport.pause_reading()
        raw = deaf.writer.get_extra_info("socket")
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        for message_id in (GLOBAL_POSITION_INT, 30, 24, 74, 1, 147):
            deaf.send(interval(message_id, 20))
        other.send(interval(GLOBAL_POSITION_INT, 10, system=2))
        async with asyncio.timeout(30.0):
            while vehicles[0].t_s < 400.0:
                await other.wait("GLOBAL_POSITION_INT")
        assert vehicles[1].t_s == vehicles[0].t_s
        # it receives again when it reads again
        deaf.writer.transport.resume_reading()
        await deaf.wait("HEARTBEAT")
        for client in (deaf, other):
            client.writer.close()


class FullTransport:
    def __init__(self):
        self.unsent = 0

    def write(self, data):
        self.unsent += len(data)

    def get_write_buffer_size(self):
        return self.unsent

    def is_closing(self):
        return False


def test_queue_of_a_client_is_bounded():
    vehicle = plain_vehicle()
    port, connection = TcpPort(vehicle), Connection(None)
    connection.transport = FullTransport()
    port.add_client(connection)
    packer = Packer(255, 190)
    for message_id in (1, 24, 30, 33, 74, 147):
        port.receive(connection, packer.pack(interval(message_id, 20)))
    for _ in range(4000):
        vehicle.step(0.05)
        port.flush()
    assert 1 << 18 < connection.transport.unsent < (1 << 18) + 5000


@in_a_loop
async def test_a_companion_that_reboots_loses_its_connection():
    async with served("tcp") as (vehicles, port, _):
        client = await Tcp.open(port)
        await client.wait("HEARTBEAT")
        vehicles[0].fail.companion_reboot(for_s=5.0)
        with pytest.raises((EOFError, ConnectionError)):
            await client.wait("messages that never come")
        client.writer.close()
        again = await Tcp.open(port)
        cut_at_s = vehicles[0].t_s
        await again.wait("HEARTBEAT")
        assert vehicles[0].t_s > cut_at_s
        again.writer.close()


@in_a_loop
async def test_a_port_that_is_taken_leaves_none_open():
    port, _ = free_ports(2, tcp=True)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", port + 10))
        taken.listen()
        vehicles = [plain_vehicle(i) for i in (1, 2)]
        with pytest.raises(OSError, match="address already in use"):
            await serve(vehicles, transport="tcp", base_port=port, http_port=None, on_ready=print)
    with socket.socket() as again:
        again.bind(("127.0.0.1", port))


def test_frames_are_never_cut():
    packer, signing = Packer(1, 1), Signing()
    signing.set_up(b"k" * 32, 5)
    frames = [packer.pack(mav.MAVLink_ping_message(n, n, 1, 1)) for n in range(100)]
    frames += [signing.sign(frame, 3) for frame in frames]
    made = datagrams(b"".join(frames))
    assert b"".join(made) == b"".join(frames)
    assert all(len(datagram) <= 1400 for datagram in made)
    assert [frame for datagram in made for frame in cut(datagram)] == frames
    assert len(made) < 8


@pytest.mark.parametrize(
    ("how", "report"),
    [
        ({"speedup": 0.0, "http_port": 1}, "speed-up"),
        ({"speedup": -1.0, "http_port": 1}, "speed-up"),
        ({"speedup": float("nan"), "http_port": 1}, "speed-up"),
        ({"http_port": 8123}, "announces them at sim://"),
        ({"transport": "pigeon", "http_port": None}, "udp"),
    ],
)
def test_invalid_options_of_a_server_are_refused(how, report):
    with pytest.raises(ValueError, match=report):
        asyncio.run(serve([plain_vehicle()], on_ready=print, **how))


async def get(port, path, extra=""):
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(f"GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n{extra}\r\n".encode())
    data = await asyncio.wait_for(reader.read(), 10.0)
    writer.close()
    head, _, body = data.partition(b"\r\n\r\n")
    return head.split(b"\r\n")[0].decode(), body


@in_a_loop
async def test_requests_that_are_not_http_are_refused():
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
