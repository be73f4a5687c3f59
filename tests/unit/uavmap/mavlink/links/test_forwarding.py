"""Forwarded frames are unchanged; one port serves several vehicles; a second service is refused."""

import asyncio
import os
import pty
import random
import socket
import tty
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from missions.mission.schema import CameraSection
from tests.support.mavlink_peer import Peer, heartbeat
from tests.support.plans import plan_of
from tests.support.ports import free_port
from tests.support.running import by, in_real_time, on_virtual_time
from uavmap.aircraft.cameras.spec import parse_camera
from uavmap.load.mission_source import load
from uavmap.mavlink.links.forwarding import Forwarding
from uavmap.mavlink.links.framing import Splitter, sender_of, target_of
from uavmap.mavlink.links.serial_port import MAX_UNSENT, SerialPort
from uavmap.mavlink.links.transports import MAX_UNSENT as MAX_UNSENT_TCP
from uavmap.mavlink.links.transports import open_transport
from uavmap.mavlink.links.urls import parse_url
from uavmap.mavlink.session import GROUND_SYSTEM_ID, Session
from uavmap.runner.flight_links import Link, check_urls, opened_links, reject_other_controllers

LOOPBACK = "127.0.0.1"


def frame(message, system=1, *, signed=False, old=False):
    codec = mav.MAVLink(None, srcSystem=system, srcComponent=1)
    if signed:
        codec.signing.secret_key, codec.signing.sign_outgoing = bytes(32), True
    return bytes(message.pack(codec, force_mavlink1=old))


def unknown(system):
    """Return a frame of a dialect that is unknown here."""
    return bytes([0xFD, 4, 0, 0, 7, system, 1, 0xFE, 0xFD, 0xAB, 1, 2, 3, 4, 0x55, 0x66])


FRAMES = [
    frame(heartbeat()),
    frame(heartbeat(), 3, signed=True),
    frame(heartbeat(), 4, old=True),
    unknown(9),
    frame(mav.MAVLink_param_request_read_message(2, 1, b"RTL_ALT", -1), 255),
    frame(mav.MAVLink_command_long_message(5, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0), 255),
    frame(mav.MAVLink_statustext_message(4, bytes([0xFD, 0xFE, 0xFD, 0x41] * 10)), 1),
]


# --- cutting -----------------------------------------------------------------------------------
@pytest.mark.parametrize("seed", range(20))
def test_frames_in_arbitrary_pieces_come_out_unchanged(seed):
    rng = random.Random(seed)
    sent = [rng.choice(FRAMES) for _ in range(60)]
    stream = b"boot banner\r\n" + b"".join(sent)
    splitter, found = Splitter(), []
    while stream:
        cut = rng.randrange(1, 70)
        found += splitter.feed(stream[:cut])
        stream = stream[cut:]
    assert found == sent


def test_junk_costs_only_the_frame_it_hit():
    rng, splitter = random.Random(7), Splitter()
    found = []
    for _ in range(300):
        found += splitter.feed(FRAMES[0] + rng.randbytes(rng.randrange(1, 40)) + FRAMES[1])
    assert sum(f == FRAMES[0] for f in found) > 200
    assert len(found) < 900


def test_addresses_are_read_without_decoding():
    assert [sender_of(f)[0] for f in FRAMES] == [1, 3, 4, 9, 255, 255, 1]
    assert [target_of(f) for f in FRAMES] == [0, 0, 0, 0, 2, 5, 0]


@pytest.mark.parametrize(
    "kind", [k for k in mav.mavlink_map.values() if "target_system" in k.fieldnames]
)
def test_target_of_every_message_is_read(kind):
    values = [b"" if t == "char" and n else [0] * n if n else 0
              for t, n in zip(kind.fieldtypes, _in_order(kind), strict=True)]  # fmt: skip
    values[kind.fieldnames.index("target_system")] = 77
    assert target_of(frame(kind(*values))) == 77


def _in_order(kind):
    by_name = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    return [by_name[name] for name in kind.fieldnames]


# --- forwarding --------------------------------------------------------------------------------
def plan(*urls, forward=()):
    return plan_of("x", load("runway"), None, None, 1, urls, None, 0.0, forward=forward)


def links_of(flown, record):
    cameras = [parse_camera("mavlink")] * len(flown.urls)
    return opened_links(flown, cameras, CameraSection(), record)


def sockets(count):
    made = []
    for _ in range(count):
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        link.bind((LOOPBACK, 0))
        link.setblocking(False)
        made.append(link)
    return made


async def received(link, least=1):
    loop, data = asyncio.get_running_loop(), b""
    async with asyncio.timeout(10.0):
        while len(data) < least:
            data += await loop.sock_recv(link, 65536)
    return data


def test_forwarded_frames_are_unchanged_in_both_directions():
    port = free_port(socket.SOCK_DGRAM)
    vehicle, ground = sockets(2)

    async def body():
        forward = (f"udpout://{LOOPBACK}:{ground.getsockname()[1]}",)
        logged = []
        flown = plan(f"udpin://{LOOPBACK}:{port}", forward=forward)
        async with links_of(flown, logged.append) as (link,):
            ours = (LOOPBACK, port)
            down = FRAMES[0] + unknown(1) + frame(heartbeat(), 1, signed=True)
            vehicle.sendto(down, ours)
            heard = await received(ground, len(down))
            assert heard == down
            assert link.session.view.system_id == 1
            up = FRAMES[4] + unknown(255) + frame(heartbeat(), 255, signed=True)
            ground_to = await _peer_of(ground, vehicle, ours)
            ground.sendto(up, ground_to)
            assert await received(vehicle, len(up)) == up
            assert FRAMES[4] in logged
            link.session.heartbeat()  # frames of the service go to the vehicle only
            await received(vehicle)
            with pytest.raises(BlockingIOError):
                ground.recv(100)

    asyncio.run(body())
    for link in (vehicle, ground):
        link.close()


async def _peer_of(ground, vehicle, ours):
    loop = asyncio.get_running_loop()
    vehicle.sendto(FRAMES[0], ours)
    async with asyncio.timeout(10.0):
        _, address = await loop.sock_recvfrom(ground, 65536)
    return address


class Wire:
    peer_host = None

    def __init__(self, destination):
        self.destination = destination
        self.sent = []

    def send(self, data):
        self.sent.append(data)


def test_frames_of_a_station_go_to_their_target():
    forwarding = Forwarding(lambda data: None)
    one, two, both = Wire("one"), Wire("two"), Wire("router")
    for system, wire in ((2, one), (5, two), (6, both), (7, both)):
        forwarding.add(SimpleNamespace(system_id=system, transport=wire))
    hear = forwarding._from_station()
    hear(FRAMES[4] + FRAMES[5] + FRAMES[0])
    assert one.sent == [FRAMES[4], FRAMES[0]]
    assert two.sent == [FRAMES[5], FRAMES[0]]
    assert both.sent == [FRAMES[0]]  # once, although two vehicles are behind it


@by(in_real_time)
async def test_station_that_does_not_read_delays_no_link():
    server = socket.create_server((LOOPBACK, 0))  # no program reads its connections
    url = parse_url(f"tcpout://{LOOPBACK}:{server.getsockname()[1]}")
    async with open_transport(url, lambda data: False) as station:
        for _ in range(200_000):
            station.send(FRAMES[0] * 10)
        tcp = station
        assert tcp._transport.get_write_buffer_size() <= MAX_UNSENT_TCP + 1000
    server.close()


def test_full_serial_port_delays_no_link_and_is_written_later():
    operator, ours = pty.openpty()
    tty.setraw(ours)

    async def body():
        port = SerialPort(os.ttyname(ours), 57600, lambda data: None)
        for _ in range(5000):
            port.send(FRAMES[0])
        assert len(port._unsent) <= MAX_UNSENT
        os.set_blocking(operator, False)
        heard = b""
        async with asyncio.timeout(10.0):
            while port._unsent:
                await asyncio.sleep(0.001)
                while True:
                    try:
                        heard += os.read(operator, 65536)
                    except BlockingIOError:
                        break
        assert set(Splitter().feed(heard)) == {FRAMES[0]}  # whole frames, and no other bytes
        port.close()

    asyncio.run(body())
    os.close(operator)
    os.close(ours)


# --- one port, several vehicles ----------------------------------------------------------------
@pytest.mark.parametrize("routed", [True, False], ids=["a router", "each its own address"])
def test_one_port_serves_several_vehicles(routed, log_lines):
    port = free_port(socket.SOCK_DGRAM)
    first, second = sockets(2)
    if routed:
        second.close()
        second = first

    async def body():
        urls = [f"udpin://{LOOPBACK}:{port}?system={system}" for system in (2, 1)]
        async with links_of(plan(*urls), lambda data: None) as links:
            ours = (LOOPBACK, port)
            for link, system in ((first, 1), (second, 2), (first, 9)):
                link.sendto(frame(heartbeat(), system), ours)
            async with asyncio.timeout(10.0):
                await links[0].session.until(lambda: links[0].session.view.system_id != 0)
                await links[1].session.until(lambda: links[1].session.view.system_id != 0)
                while not log_lines:  # noqa: ASYNC110
                    await asyncio.sleep(0.001)
            assert [link.session.view.system_id for link in links] == [2, 1]
            links[0].session.heartbeat()
            assert await received(second)

    asyncio.run(body())
    assert log_lines == [
        f"udpin://{LOOPBACK}:{port}: system 9 sends here, and is no vehicle of this flight"
    ]
    for link in {first, second}:
        link.close()


@by(on_virtual_time)
async def test_frame_of_another_system_is_ignored():
    session = Session(lambda data: None, lambda data: None)
    session.view.wanted_system = 2
    session.feed(frame(heartbeat(), 1))
    assert session.view.system_id == 0
    session.feed(frame(heartbeat(), 2))
    assert session.view.system_id == 2


@pytest.mark.parametrize(
    "urls",
    [
        ["udpin://0.0.0.0:14550", "udp:0.0.0.0:14550"],
        ["udpin://0.0.0.0:14550?system=1", "udpin://0.0.0.0:14550"],
        ["udpin://0.0.0.0:14550?system=1", "udpin://0.0.0.0:14550?system=1"],
    ],
)
def test_two_vehicles_on_one_port_need_system_numbers(urls):
    with pytest.raises(LinkError, match=r"\?system=1, .*\?system=2"):
        check_urls(urls)


# --- a second process of ours ------------------------------------------------------------------
def own_heartbeat(process):
    message = mav.MAVLink_heartbeat_message(18, 8, 0, process, 4, 3)
    return bytes(message.pack(mav.MAVLink(None, srcSystem=GROUND_SYSTEM_ID, srcComponent=191)))


@pytest.mark.parametrize(("heard", "refused"), [(7, False), (8, True), (None, False)])
@by(on_virtual_time)
async def test_another_uavmap_on_the_vehicle_is_refused(heard, refused):
    peer = Peer()
    peer.session.process_number = 7
    link = Link("udpin://0.0.0.0:1", peer.session, _no_pictures)
    peer.send(heartbeat())
    await asyncio.sleep(0.1)
    if heard is not None:
        asyncio.get_running_loop().call_later(0.5, peer.session.feed, own_heartbeat(heard))
    if refused:
        with pytest.raises(LinkError, match="another uavmap flies this vehicle"):
            await reject_other_controllers([link], 1.5)
    else:
        await reject_other_controllers([link], 1.5)
        assert asyncio.get_running_loop().time() < 1.7


async def _no_pictures(url):
    raise LinkError(url)
