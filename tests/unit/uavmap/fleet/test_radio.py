"""Radios on loopback: Zenoh and multicast; endpoints and texts of --comms as written."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import socket
import time
from collections.abc import AsyncIterator, Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions.errors import LinkError
from missions.fleet_events import Partition
from missions.lab.arena.arena_run import Comms
from missions.lab.arena.radio import Links
from tests.support.ports import free_port
from tests.support.running import by, in_real_time
from uavmap.fleet.radio import MulticastRadio, Radios, parse_endpoint
from uavmap.fleet.simulated_radio import LinkModel, link_model
from uavmap.fleet.zenoh_radio import ZenohLinks, ZenohRadio
from uavmap.lab.simulating import simulated_links

PATIENCE_S = 30.0
LOOK_S = 0.02


class Receiver:
    """A receiver that keeps all messages."""

    def __init__(self, radio: ZenohRadio | MulticastRadio | Radios) -> None:
        self.received: set[bytes] = set()
        radio.listen(self.received.add)


async def until(condition: Callable[[], bool], meanwhile: Callable[[], None]) -> None:
    """Repeat an action until a condition holds: any datagram may be lost."""
    due_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < due_s
        meanwhile()
        await asyncio.sleep(LOOK_S)


async def exchanged(
    one: ZenohRadio, at_one: Receiver, other: ZenohRadio, at_other: Receiver, word: bytes
) -> None:
    """Have two radios send to each other until both have received."""

    def speak() -> None:
        one.send(b"to other")
        other.send(word)

    await until(lambda: word in at_one.received and b"to other" in at_other.received, speak)


@contextlib.asynccontextmanager
async def over_zenoh(**where: str) -> AsyncIterator[ZenohRadio]:
    links = ZenohLinks(**{name: (parse_endpoint("--x", text),) for name, text in where.items()})
    radio = ZenohRadio(links, "uavmap/test")
    radio.open()
    try:
        yield radio
    finally:
        await radio.close()


@pytest.mark.parametrize("kind", ["tcp", "udp"])
@by(in_real_time)
async def test_radio_that_was_gone_and_returns_is_received_again(kind, log_lines):
    pytest.importorskip("zenoh", reason="the extra fleet is not installed")
    type_ = socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM
    endpoint = f"{kind}/127.0.0.1:{free_port(type_)}"
    async with over_zenoh(listen=endpoint) as one:
        at_one = Receiver(one)
        for word in (b"first", b"second"):
            async with over_zenoh(peers=endpoint) as other:
                await exchanged(one, at_one, other, Receiver(other), word)
        assert one.opened == 1
        assert b"to other" not in at_one.received  # no radio receives its own messages
        one.send(bytes(2000))  # larger than any message: left out
    assert log_lines == []


@by(in_real_time)
async def test_port_in_use_is_reported_and_tried_again(log_lines):
    pytest.importorskip("zenoh", reason="the extra fleet is not installed")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        async with over_zenoh(listen=endpoint) as radio:
            await until(lambda: bool(log_lines), lambda: radio.send(b"into the void"))
    assert len(log_lines) == 1
    assert log_lines[0].endswith("tried again")
    assert re.search(r"/[^/\s]+/", log_lines[0]) is None, "a path of a machine is told"
    assert ".rs" not in log_lines[0]


def group(interface: str) -> MulticastRadio:
    port = free_port(socket.SOCK_DGRAM)
    endpoint = parse_endpoint("--listen", f"udp/224.0.0.224:{port}#iface={interface}")
    return MulticastRadio(endpoint)


@by(in_real_time)
async def test_message_to_a_group_reaches_all_of_it():
    one = group("lo")
    others = [MulticastRadio(one._endpoint) for _ in range(2)]
    ears = [Receiver(radio) for radio in (one, *others)]
    for radio in (one, *others):
        radio.open()
    try:
        await until(
            lambda: all(b"to all" in ear.received for ear in ears[1:]),
            lambda: Radios((one,)).send(b"to all"),
        )
        one.send(bytes(2000))
    finally:
        for radio in (one, *others):
            radio.close()
    assert all(ear.received <= {b"to all"} for ear in ears)


@by(in_real_time)
async def test_missing_interface_is_reported_once_and_waited_for(log_lines):
    endpoint = parse_endpoint("--listen", "udp/224.0.0.224:7447#iface=none0")
    radio = MulticastRadio(endpoint)
    radio.open()
    radio.open()
    radio.send(b"into the void")
    radio.close()
    assert len(log_lines) == 1
    assert "it is tried again" in log_lines[0]


@by(in_real_time)
async def test_two_radios_exchange_messages_by_a_router():
    zenoh = pytest.importorskip("zenoh", reason="the extra fleet is not installed")
    endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    async with over_zenoh(routers=endpoint) as one:
        with zenoh.open(config):  # it starts after the first has called
            async with over_zenoh(routers=endpoint) as other:
                await exchanged(one, Receiver(one), other, Receiver(other), b"word")


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("tcp/0.0.0.0:7447", "tcp/0.0.0.0:7447"),
        ("udp/drone-2.local:7447", "udp/drone-2.local:7447"),
        ("tcp/[fe80::1]:7447#iface=wlan0", "tcp/[fe80::1]:7447#iface=wlan0"),
        ("udp/224.0.0.224:7447#iface=wlan0", "udp/224.0.0.224:7447#iface=wlan0"),
    ],
)
def test_endpoint_comes_back_as_it_was_written(text, url):
    assert parse_endpoint("--listen", text).url == url


@pytest.mark.parametrize(
    ("option", "text", "remedy"),
    [
        ("--peer", "192.168.7.2:7447", "write tcp/"),
        ("--peer", "http/drone:80", "write tcp/"),
        ("--peer", "tcp/drone", "write tcp/"),
        ("--peer", "tcp/drone:0", "a port is 1 to 65535"),
        ("--peer", "tcp/drone:70000", "a port is 1 to 65535"),
        ("--peer", "udp/224.0.0.224:7447#iface=wlan0", "--listen udp/224.0.0.224"),
        ("--listen", "udp/224.0.0.224:7447", "#iface=wlan0"),
        ("--listen", "tcp/224.0.0.224:7447#iface=wlan0", "udp/224.0.0.224"),
    ],
)
def test_invalid_endpoint_is_refused_with_a_remedy(option, text, remedy):
    with pytest.raises(LinkError) as refused:
        parse_endpoint(option, text)
    assert str(refused.value).startswith(f"{option} {text}: ")
    assert remedy in str(refused.value)


in_flight: Callable[[str], object] = link_model


def on_the_grid(text: str) -> Comms | Links:
    return simulated_links(text, 4, 7)


@pytest.mark.parametrize(
    ("text", "model"),
    [
        ("free", LinkModel()),
        ("meeting,delay:0", LinkModel(range_m=20.0, delay_s=0.0)),
        (
            "range:200,loss:0.1,delay:0.1,jitter:0.05,rate:300",
            LinkModel(200.0, 0.1, 0.1, 0.05, bytes_per_s=300.0),
        ),
    ],
)
def test_link_model_in_flight_is_read_from_its_text(text, model):
    assert link_model(text) == model


@pytest.mark.parametrize(
    ("text", "links"),
    [
        ("shared", Comms.SHARED),
        ("free", Comms.SHARED),
        ("meeting", Comms.MEETING),
        ("range:8", Links(8.0, seed=7)),
        ("range:inf", Links(seed=7)),
        ("shared,loss:1", Links(loss=1.0, seed=7)),
        ("range:2.5,loss:0.1,delay:3,rate:0.5", Links(2.5, 0.1, 3.0, 0.5, seed=7)),
        (
            "free,apart:0-4,apart:6.5-9:1+2/4",
            Links(
                apart=(
                    Partition(0.0, 4.0),
                    Partition(6.5, 9.0, (frozenset({0, 1}), frozenset({3}))),
                ),
                seed=7,
            ),
        ),
    ],
)
def test_link_model_on_the_grid_is_read_from_its_text(text, links):
    assert on_the_grid(text) == links


@pytest.mark.parametrize("read", [in_flight, on_the_grid])
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "'' is none of"),
        ("near", "'near' is none of"),
        ("free:3", "'free:3' is none of"),
        ("range", "range: is not a number; it is a distance in"),
        ("range:x", "range:x is not a number"),
        ("range:nan", "range:nan is not a number"),
        ("range:-1", "range:-1 has to be 0 or more"),
        ("free,", "'' is not known; after a comma stands one of loss, delay"),
        ("free,colour:1", "'colour' is not known"),
        ("free,loss:1.5", "loss:1.5 is above 1; it is the share that is lost"),
        ("free,delay:inf", "delay:inf is not a number; it is a time"),
        ("free,rate:0", "rate:0 has to be above 0"),
        ("free,loss:0.1,loss:0.2", "loss stands there twice"),
    ],
)
def test_invalid_link_model_is_refused_with_a_reason(read, text, expected):
    with pytest.raises(ValueError, match=re.escape(expected)):
        read(text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("meeting,loss:0.1", "write meeting alone"),
        ("meeting,apart:1-2", "write meeting alone"),
        ("free,jitter:1", "one of loss, delay, rate, apart"),
        ("free,apart:5", "write apart:BEGIN-END"),
        ("free,apart:9-3", "ends before it begins"),
        ("free,apart:3-3", "ends before it begins"),
        ("free,apart:1-2:", "write apart:BEGIN-END"),
        ("free,apart:1-2:1++2", "write apart:BEGIN-END"),
        ("free,apart:1-2:0+1", "robot 0 is none of 1 to 4"),
        ("free,apart:1-2:1+5", "robot 5 is none of 1 to 4"),
        ("free,apart:1-2:1+2/2", "robot 2 is named twice"),
    ],
)
def test_invalid_link_model_on_the_grid_is_refused_with_a_reason(text, expected):
    with pytest.raises(ValueError, match=re.escape(expected)):
        on_the_grid(text)


@given(
    st.sampled_from(["", "range:5,", "free,apart:"]),
    st.text("rangefloosdtyp:,.+-/0123456789 einfx", max_size=30),
)
def test_arbitrary_text_is_a_link_model_or_a_value_error(start, text):
    for read in (in_flight, on_the_grid):
        with contextlib.suppress(ValueError):
            read(start + text)
