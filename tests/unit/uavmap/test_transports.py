"""Transports against each other over loopback and a pseudo-terminal, in real time."""

from __future__ import annotations

import asyncio
import gc
import os
import pty
import socket
import tty
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest

from missions.errors import LinkError
from uavmap.link import transports
from uavmap.link.transports import open_transport
from uavmap.link.urls import Endpoint, parse_url

SOON_S = 5.0


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


class Ear:
    """Collects what a transport hears."""

    def __init__(self) -> None:
        self.data = b""
        self._more = asyncio.Event()

    def __call__(self, data: bytes) -> None:
        self.data += data
        self._more.set()

    async def hears(self, expected: bytes) -> None:
        async with asyncio.timeout(SOON_S):
            while expected not in self.data:
                self._more.clear()
                await self._more.wait()


def on_loop(body: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run a test and find what it left behind: descriptors, tasks, unclosed sockets."""

    async def main() -> None:
        await body()
        await asyncio.sleep(0.01)
        assert len(asyncio.all_tasks()) == 1

    before = len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").is_dir() else None
    asyncio.run(main())
    gc.collect()
    if before is not None:
        assert len(os.listdir("/proc/self/fd")) == before


@pytest.mark.parametrize(
    ("there", "kind"), [("udp", socket.SOCK_DGRAM), ("tcp", socket.SOCK_STREAM)]
)
def test_in_and_out_speak_to_each_other(there: str, kind: socket.SocketKind) -> None:
    port = free_port(kind)

    async def body() -> None:
        at_home, outside = Ear(), Ear()
        listening = parse_url(f"{there}in://127.0.0.1:{port}")
        calling = parse_url(f"{there}out://127.0.0.1:{port}")
        async with open_transport(listening, at_home) as server:
            server.send(b"nobody is there yet")
            async with open_transport(calling, outside) as client:
                client.send(b"hello")
                await at_home.hears(b"hello")
                server.send(b"and hello")
                await outside.hears(b"and hello")
                assert b"nobody" not in outside.data

    on_loop(body)


def test_a_listening_udp_socket_keeps_to_who_spoke_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    port = free_port(socket.SOCK_DGRAM)

    async def body() -> None:
        ear, first, second = Ear(), Ear(), Ear()
        url = parse_url(f"udpout://127.0.0.1:{port}")
        async with (
            open_transport(parse_url(f"udpin://127.0.0.1:{port}"), ear) as server,
            open_transport(url, first) as one,
            open_transport(url, second) as two,
        ):
            one.send(b"one")
            await ear.hears(b"one")
            two.send(b"stranger")
            one.send(b"again")
            await ear.hears(b"again")
            assert b"stranger" not in ear.data
            server.send(b"answer")
            await first.hears(b"answer")
            monkeypatch.setattr(transports, "PEER_SILENT_S", 0.0)  # as if the first fell silent
            two.send(b"successor")
            await ear.hears(b"successor")
            server.send(b"more")
            await second.hears(b"more")
            assert first.data == b"answer"

    on_loop(body)


def test_a_tcp_server_keeps_the_latest_client() -> None:
    port = free_port(socket.SOCK_STREAM)

    async def body() -> None:
        ear, first, second = Ear(), Ear(), Ear()
        url = parse_url(f"tcpout://127.0.0.1:{port}")
        async with (
            open_transport(parse_url(f"tcpin://127.0.0.1:{port}"), ear) as server,
            open_transport(url, first) as one,
        ):
            one.send(b"one")
            await ear.hears(b"one")
            async with open_transport(url, second) as two:
                two.send(b"two")
                await ear.hears(b"two")
                server.send(b"answer")
                await second.hears(b"answer")
                assert first.data == b""

    on_loop(body)


def test_sending_where_nobody_listens_is_no_error() -> None:
    udp, tcp = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)

    async def body() -> None:
        async with open_transport(parse_url(f"udpout://127.0.0.1:{udp}"), Ear()) as transport:
            for _ in range(5):
                transport.send(b"anybody?")
                await asyncio.sleep(0.005)
        heard, ear = Ear(), Ear()
        async with (
            open_transport(parse_url(f"tcpin://127.0.0.1:{tcp}"), heard),
            open_transport(parse_url(f"tcpout://127.0.0.1:{tcp}"), ear) as transport,
        ):
            transport.send(b"x")
            await heard.hears(b"x")
        for _ in range(5):  # its end is gone
            transport.send(b"anybody?")
            await asyncio.sleep(0.005)

    on_loop(body)


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
def test_what_cannot_be_opened_is_a_link_error_that_names_it(url: str) -> None:
    async def body() -> None:
        with pytest.raises(LinkError) as caught:
            async with open_transport(parse_url(url), Ear()):
                pass
        assert url in str(caught.value)
        assert "cannot be opened" in str(caught.value)
        assert "\n" not in str(caught.value)

    on_loop(body)


def test_two_cannot_listen_on_one_port() -> None:
    port = free_port(socket.SOCK_DGRAM)

    async def body() -> None:
        url = parse_url(f"udpin://127.0.0.1:{port}")
        async with open_transport(url, Ear()):
            with pytest.raises(LinkError, match=str(port)):
                async with open_transport(url, Ear()):
                    pass

    on_loop(body)


def pseudo_terminal() -> tuple[int, str]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)
    os.close(slave)
    return master, name


def test_serial_both_ways() -> None:
    async def body() -> None:
        master, name = pseudo_terminal()
        ear, loop = Ear(), asyncio.get_running_loop()
        every_byte = bytes(range(256))
        try:
            async with open_transport(Endpoint("serial", name, 57600), ear) as port:
                os.write(master, every_byte)
                await ear.hears(every_byte)
                port.send(every_byte)
                got = b""
                while len(got) < 256:
                    got += await loop.run_in_executor(None, os.read, master, 256)
                assert got == every_byte
        finally:
            os.close(master)

    on_loop(body)


def test_a_serial_port_that_is_unplugged_raises_nothing() -> None:
    async def body() -> None:
        master, name = pseudo_terminal()
        ear = Ear()
        async with open_transport(Endpoint("serial", name, 57600), ear) as port:
            os.write(master, b"frame")
            await ear.hears(b"frame")
            os.close(master)
            for _ in range(5):
                port.send(b"anybody?")
                await asyncio.sleep(0.01)
            assert ear.data == b"frame"

    on_loop(body)


def test_an_impossible_baud_rate_is_a_link_error() -> None:
    async def body() -> None:
        master, name = pseudo_terminal()
        try:
            with pytest.raises(LinkError, match="cannot be opened"):
                async with open_transport(Endpoint("serial", name, 10**12), Ear()):
                    pass
        finally:
            os.close(master)

    on_loop(body)


@pytest.mark.parametrize("transport", ["udpin", "tcpin"])
def test_closing_frees_the_port_at_once_also_on_an_error(transport: str) -> None:
    kind = socket.SOCK_DGRAM if transport == "udpin" else socket.SOCK_STREAM
    port = free_port(kind)

    async def body() -> None:
        for _ in range(3):
            with pytest.raises(ZeroDivisionError):
                async with open_transport(parse_url(f"{transport}://127.0.0.1:{port}"), Ear()):
                    raise ZeroDivisionError

    on_loop(body)
