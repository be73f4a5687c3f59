"""Transports exchange bytes over loopback and a pseudo-terminal, in real time."""

import asyncio
import contextlib
import gc
import os
import pty
import socket
import tty
from pathlib import Path

import pytest

from missions.errors import LinkError
from tests.support.ports import free_port
from tests.support.running import by
from uavmap.mavlink.links import serial_port, transports
from uavmap.mavlink.links.transports import open_transport
from uavmap.mavlink.links.urls import Endpoint, parse_url

SOON_S = 120.0


class Collected:
    def __init__(self):
        self._more = asyncio.Event()

    async def until(self, so):
        async with asyncio.timeout(SOON_S):
            while not so():
                self._more.clear()
                await self._more.wait()


class Receiver(Collected):
    """A receiver of a transport; bytes that do not begin with a "?" are the vehicle's."""

    data = b""

    def __call__(self, data):
        self.data += data
        self._more.set()
        return not data.startswith(b"?")

    async def receives(self, expected):
        await self.until(lambda: expected in self.data)


class ShownLines(Collected):
    def __init__(self):
        super().__init__()
        self.lines = []

    def __call__(self, line):
        self.lines.append(line)
        self._more.set()

    async def shows(self, part):
        await self.until(lambda: any(part in line for line in self.lines))


def at(transport, port):
    return parse_url(f"{transport}://127.0.0.1:{port}")


def on_loop(body):
    """Run a test and check that it leaves no descriptors, tasks or unclosed sockets."""

    async def main():
        await body()
        await asyncio.sleep(0.01)
        assert len(asyncio.all_tasks()) == 1

    gc.collect()  # leftovers of other tests are not counted
    before = len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").is_dir() else None
    asyncio.run(main())
    gc.collect()
    if before is not None:
        assert len(os.listdir("/proc/self/fd")) == before


@by(on_loop)
async def test_udp_socket_with_backlog_is_read_until_empty_in_one_turn():
    """A busy computer read a real vehicle's telemetry up to 3.4 s late, a datagram a turn.

    "12 m off its path by now" ended a mission whose vehicle was 2.6 m off.
    """
    port, ear = free_port(socket.SOCK_DGRAM), Receiver()
    async with open_transport(at("udpin", port), ear):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            for number in range(100):
                vehicle.sendto(f"{number:04d}".encode(), ("127.0.0.1", port))
        for _ in range(3):
            await asyncio.sleep(0)
        assert ear.data == b"".join(f"{number:04d}".encode() for number in range(100))


@pytest.mark.parametrize(
    ("there", "kind"), [("udp", socket.SOCK_DGRAM), ("tcp", socket.SOCK_STREAM)]
)
@by(on_loop)
async def test_listener_and_caller_exchange_bytes(there, kind):
    port = free_port(kind)
    at_home, outside = Receiver(), Receiver()
    listening = at(f"{there}in", port)
    calling = at(f"{there}out", port)
    async with open_transport(listening, at_home) as server:
        server.send(b"nobody is there yet")
        async with open_transport(calling, outside) as client:
            client.send(b"hello")
            await at_home.receives(b"hello")
            server.send(b"and hello")
            await outside.receives(b"and hello")
            assert b"nobody" not in outside.data


@by(on_loop)
async def test_udp_listener_keeps_to_its_vehicle(monkeypatch):
    port = free_port(socket.SOCK_DGRAM)
    ear, told, first, second = Receiver(), ShownLines(), Receiver(), Receiver()
    url = at("udpout", port)
    listening = at("udpin", port)
    async with (
        open_transport(listening, ear, told) as server,
        open_transport(url, first) as one,
        open_transport(url, second) as two,
    ):
        two.send(b"?noise")  # a sender that is no vehicle
        await ear.receives(b"?noise")
        assert server.peer_host is None
        one.send(b"one")
        await ear.receives(b"one")
        assert server.peer_host == "127.0.0.1"
        for _ in range(3):
            two.send(b"stranger")
        await told.shows("is ignored")
        one.send(b"again")
        await ear.receives(b"again")
        assert b"stranger" not in ear.data
        server.send(b"answer")
        await first.receives(b"answer")
        monkeypatch.setattr(transports, "PEER_SILENT_S", 0.0)  # as if the first fell silent
        two.send(b"?no vehicle of ours")
        await ear.receives(b"of ours")
        server.send(b"still")
        await first.receives(b"still")
        two.send(b"successor")
        await ear.receives(b"successor")
        await told.shows("the vehicle is received from")
        server.send(b"more")
        await second.receives(b"more")
        assert first.data == b"answerstill"
    assert len(told.lines) == 2  # a stranger is named once


@by(on_loop)
async def test_named_udp_peer_is_never_replaced(monkeypatch):
    monkeypatch.setattr(transports, "PEER_SILENT_S", 0.0)
    ear, told, loop = Receiver(), ShownLines(), asyncio.get_running_loop()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        for end in (peer, stranger):
            end.bind(("127.0.0.1", 0))
            end.setblocking(False)
        url = parse_url(f"udpout://127.0.0.1:{peer.getsockname()[1]}")
        async with open_transport(url, ear, told) as ours, asyncio.timeout(SOON_S):
            ours.send(b"hello")
            _, address = await loop.sock_recvfrom(peer, 64)
            stranger.sendto(b"I am your vehicle", address)
            await told.shows("sends as well, and is ignored")
            peer.sendto(b"and here I am", address)
            await ear.receives(b"and here I am")
            ours.send(b"a command")
            assert await loop.sock_recv(peer, 64) == b"a command"
            with pytest.raises(BlockingIOError):
                stranger.recv(64)
            assert b"your vehicle" not in ear.data
            assert ours.peer_host == "127.0.0.1"


@by(on_loop)
async def test_many_strangers_are_not_all_reported():
    port = free_port(socket.SOCK_DGRAM)
    ear, told = Receiver(), ShownLines()
    url = at("udpin", port)
    async with (
        open_transport(url, ear, told),
        open_transport(at("udpout", port), Receiver()) as vehicle,
    ):
        vehicle.send(b"vehicle")
        await ear.receives(b"vehicle")
        for _ in range(transports.MAX_STRANGERS + 20):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
                stranger.sendto(b"stranger", ("127.0.0.1", port))
        vehicle.send(b"last")
        await ear.receives(b"last")
        assert 10 <= len(told.lines) <= transports.MAX_STRANGERS


@by(on_loop)
async def test_tcp_server_refuses_a_second_client_while_it_has_one():
    port = free_port(socket.SOCK_STREAM)
    ear, told, first = Receiver(), ShownLines(), Receiver()
    calling = at("tcpout", port)
    async with open_transport(at("tcpin", port), ear, told) as server:
        async with open_transport(calling, first) as one:
            one.send(b"one")
            await ear.receives(b"one")
            for _ in range(3):
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.write(b"stranger")
                try:
                    async with asyncio.timeout(SOON_S):
                        assert await reader.read() == b""
                except ConnectionError:
                    pass  # reset: refused as well
                writer.close()
            server.send(b"answer")
            await first.receives(b"answer")
            one.send(b"again")
            await ear.receives(b"again")
        assert b"stranger" not in ear.data
        assert len(told.lines) == 1
        assert "127.0.0.1 tries to connect as well, and is refused" in told.lines[0]
        await reconnect(port, ear)  # the first has gone: the next is welcome
        assert server.peer_host is None or server.peer_host == "127.0.0.1"


async def reconnect(port, ear):
    """Connect until the server has noticed that its client is gone."""
    async with asyncio.timeout(SOON_S):
        while b"the next" not in ear.data:
            with contextlib.suppress(ConnectionError, LinkError):
                url = at("tcpout", port)
                async with open_transport(url, Receiver()) as client:
                    client.send(b"the next")
                    await asyncio.sleep(0.01)


@by(on_loop)
async def test_sending_without_a_listener_is_no_error():
    udp, tcp = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
    async with open_transport(at("udpout", udp), Receiver()) as transport:
        for _ in range(5):
            transport.send(b"anybody?")
            await asyncio.sleep(0.005)
    heard, ear = Receiver(), Receiver()
    async with (
        open_transport(at("tcpin", tcp), heard),
        open_transport(at("tcpout", tcp), ear) as transport,
    ):
        transport.send(b"x")
        await heard.receives(b"x")
    for _ in range(5):  # its end is gone
        transport.send(b"anybody?")
        await asyncio.sleep(0.005)


@pytest.mark.parametrize(
    "url",
    [
        f"tcpout://127.0.0.1:{free_port(socket.SOCK_STREAM)}",
        "udpin://192.0.2.1:14550",
        "tcpin://192.0.2.1:5760",
        "serial:///dev/no-such-port:57600",
    ],
    ids=["tcpout", "udpin", "tcpin", "serial"],
)
@by(on_loop)
async def test_link_that_cannot_be_opened_is_an_error_that_names_it(url):
    with pytest.raises(LinkError) as caught:
        async with open_transport(parse_url(url), Receiver()):
            pass
    assert url in str(caught.value)
    assert "cannot be opened" in str(caught.value)
    assert "\n" not in str(caught.value)


@by(on_loop)
async def test_second_listener_on_a_port_is_refused():
    port = free_port(socket.SOCK_DGRAM)
    url = at("udpin", port)
    async with open_transport(url, Receiver()):
        with pytest.raises(LinkError, match=f"{port}.*another program listens there.*--forward"):
            async with open_transport(url, Receiver()):
                pass


def pseudo_terminal():
    master, slave = pty.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)
    os.close(slave)
    return master, name


@by(on_loop)
async def test_serial_port_carries_every_byte_both_ways():
    master, name = pseudo_terminal()
    ear, loop = Receiver(), asyncio.get_running_loop()
    every_byte = bytes(range(256))
    try:
        async with open_transport(Endpoint("serial", name, 57600), ear) as port:
            os.write(master, every_byte)
            await ear.receives(every_byte)
            port.send(every_byte)
            got = b""
            while len(got) < 256:
                got += await loop.run_in_executor(None, os.read, master, 256)
            assert got == every_byte
    finally:
        os.close(master)


@by(on_loop)
async def test_serial_port_that_is_unplugged_raises_nothing():
    master, name = pseudo_terminal()
    ear = Receiver()
    async with open_transport(Endpoint("serial", name, 57600), ear) as port:
        os.write(master, b"frame")
        await ear.receives(b"frame")
        os.close(master)
        for _ in range(5):
            port.send(b"anybody?")
            await asyncio.sleep(0.01)
        assert ear.data == b"frame"


@by(on_loop)
async def test_tcp_connection_that_ends_is_made_again(monkeypatch):
    monkeypatch.setattr(transports, "REOPEN_S", 0.01)
    port = free_port(socket.SOCK_STREAM)
    ear, vehicle, loop = Receiver(), Receiver(), asyncio.get_running_loop()
    listening = at("tcpin", port)
    async with contextlib.AsyncExitStack() as stack:
        server = contextlib.AsyncExitStack()
        one = await server.enter_async_context(open_transport(listening, vehicle))
        link = await stack.enter_async_context(open_transport(at("tcpout", port), ear))
        link.send(b"before")
        await vehicle.receives(b"before")
        one.send(b"here")
        await ear.receives(b"here")
        await server.aclose()  # the autopilot's end restarts
        due_s = loop.time() + SOON_S
        while link.peer_host is not None:
            assert loop.time() < due_s
            await asyncio.sleep(0.005)
        link.send(b"to nobody")
        again = await stack.enter_async_context(open_transport(listening, vehicle))
        while link.peer_host is None:
            assert loop.time() < due_s
            await asyncio.sleep(0.005)
        link.send(b"after")
        await vehicle.receives(b"beforeafter")
        again.send(b"too")
        await ear.receives(b"heretoo")


@by(on_loop)
async def test_serial_port_that_is_plugged_in_again_continues(monkeypatch, tmp_path):
    monkeypatch.setattr(serial_port, "REOPEN_S", 0.01)
    plug = tmp_path / "ttyACM0"
    ear, loop = Receiver(), asyncio.get_running_loop()
    master, name = pseudo_terminal()
    plug.symlink_to(name)
    async with open_transport(Endpoint("serial", str(plug), 57600), ear) as port:
        os.write(master, b"frame")
        await ear.receives(b"frame")
        plug.unlink()
        os.close(master)
        await asyncio.sleep(0.05)  # several failed attempts
        port.send(b"anybody?")
        master, name = pseudo_terminal()
        plug.symlink_to(name)
        due_s = loop.time() + SOON_S
        while b"again" not in ear.data:
            assert loop.time() < due_s
            os.write(master, b"again")
            await asyncio.sleep(0.02)
        port.send(b"here")
        assert await loop.run_in_executor(None, os.read, master, 4) == b"here"
    os.close(master)


@by(on_loop)
async def test_impossible_baud_rate_is_a_link_error():
    master, name = pseudo_terminal()
    try:
        with pytest.raises(LinkError, match="cannot be opened"):
            async with open_transport(Endpoint("serial", name, 10**12), Receiver()):
                pass
    finally:
        os.close(master)


@pytest.mark.parametrize("transport", ["udpin", "tcpin"])
@by(on_loop)
async def test_closing_frees_the_port_at_once_also_on_an_error(transport):
    kind = socket.SOCK_DGRAM if transport == "udpin" else socket.SOCK_STREAM
    port = free_port(kind)
    for _ in range(3):
        with pytest.raises(ZeroDivisionError):
            async with open_transport(at(transport, port), Receiver()):
                raise ZeroDivisionError
