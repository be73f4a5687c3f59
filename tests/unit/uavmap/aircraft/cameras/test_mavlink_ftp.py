"""Pictures over MAVLink FTP, from a server that loses packets."""

import asyncio
import random

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError
from tests.support.mavlink_peer import Peer, heartbeat
from tests.support.running import by
from uavmap.aircraft.cameras import mavlink as ftp
from uavmap.aircraft.cameras.mavlink import MavlinkSource
from uavmap.base.clock import VirtualClock, run

PICTURE = random.Random(3).randbytes(50_000)
BURST_PACKETS = 20
ACK = 128


class Server:
    """The files of a camera component; `loses` decides for each packet whether it is lost."""

    def __init__(self, peer, loses):
        self.files = {b"/DCIM/1.jpg": PICTURE, b"/empty.jpg": b""}
        self.peer, self.loses = peer, loses
        self.open = {}
        peer.answer = self.receive

    def receive(self, message):
        if message.get_type() != "FILE_TRANSFER_PROTOCOL" or self.loses():
            return
        assert (message.target_system, message.target_component) == (1, 100)
        payload = bytes(message.payload)
        sequence, session, opcode, size, _, _, offset = ftp._HEAD.unpack_from(payload)
        data = payload[ftp._HEAD.size : ftp._HEAD.size + size]
        sequence += 1
        if opcode == ftp.OPEN:
            if data not in self.files:
                self.reply(sequence, 0, ftp.NAK, opcode, b"\x0a", 0)
                return
            self.open = {7: self.files[data]}
            size_of = len(self.files[data]).to_bytes(4, "little")
            self.reply(sequence, 7, ACK, opcode, size_of, 0)
        elif opcode == ftp.BURST:
            content = self.open[session]
            for packet in range(BURST_PACKETS):
                part = content[offset : offset + 239]
                if not part:
                    self.reply(sequence, session, ftp.NAK, opcode, b"\x06", offset)
                    return
                last = packet == BURST_PACKETS - 1
                self.reply(sequence + packet, session, ACK, opcode, part, offset, last)
                offset += len(part)
        elif opcode == ftp.TERMINATE:
            self.open.clear()

    def reply(
        self, sequence, session, opcode, of, data, offset,
        last = False
    ):  # fmt: skip
        if self.loses():
            return
        head = ftp._HEAD.pack(sequence & 0xFFFF, session, opcode, len(data), of, last, offset)
        payload = list((head + data).ljust(251, b"\0"))
        self.peer.send(
            mav.MAVLink_file_transfer_protocol_message(0, 245, 191, payload), component=100
        )


def served(body, loses=lambda: False):
    async def main():
        peer = Peer()
        server = Server(peer, loses)
        peer.session.feed(peer.frame(heartbeat()))

        async def by_http(url):
            return url.encode()

        source = MavlinkSource(peer.session, by_http)
        await body(server, source.fetch)

    run(main(), VirtualClock())


@by(served)
async def test_picture_comes_whole(server, fetch, /):
    assert await fetch("mftp:///DCIM/1.jpg") == PICTURE
    assert await fetch("mftp://[;comp=100]/DCIM/1.jpg") == PICTURE
    assert await fetch("mftp:///empty.jpg") == b""
    await asyncio.sleep(1.0)
    assert server.open == {}


def test_picture_over_a_link_that_loses_a_fifth_comes_whole():
    async def body(server, fetch):
        assert await fetch("mftp:///DCIM/1.jpg") == PICTURE

    rng = random.Random(5)
    served(body, lambda: rng.random() < 0.2)


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("mftp:///none.jpg", "there is no such file"),
        ("mftp://", "it names no file"),
        ("mftp://[;comp=1000]/x", "it names no file"),
        ("mftp:///\x1b[2J", "it names no file"),
    ],
)
@by(served)
async def test_picture_that_cannot_be_fetched_is_a_link_error(server, fetch, /, url, reason):
    with pytest.raises(LinkError, match=f"cannot be fetched: {reason}") as raised:
        await fetch(url)
    assert str(raised.value).isprintable()


def test_silence_of_the_server_ends_the_wait():
    async def body(server, fetch):
        with pytest.raises(LinkError, match="it does not answer"):
            await fetch("mftp:///DCIM/1.jpg")
        assert asyncio.get_running_loop().time() < 10.0

    served(body, lambda: True)


@by(served)
async def test_other_addresses_go_by_http(server, fetch, /):
    assert await fetch("http://127.0.0.1/1.jpg") == b"http://127.0.0.1/1.jpg"
