"""Any answer of the camera's HTTP server gives a picture or a `LinkError`."""

import asyncio
import contextlib
import os
import socket
import threading
import time
from pathlib import Path

import pytest

from missions.errors import LinkError
from tests.support.ports import free_port
from uavmap.aircraft.imaging import http_pictures
from uavmap.aircraft.imaging.http_pictures import PictureFetcher
from uavmap.base.clock import ScaledClock, run

OK = b"HTTP/1.0 200 OK\r\n"
LOOPBACK = ("127.0.0.1",)


def fetch(url, *hosts, timeout_s=10.0):
    return asyncio.run(PictureFetcher(lambda: hosts or LOOPBACK, timeout_s)(url))


class Server:
    def __init__(self, talk):
        self._talk = talk
        self.clients = 0
        self.request = b""
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/1/0.jpg"
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def _serve(self):
        with contextlib.suppress(OSError):  # the socket is closed, or the other end hangs up first
            while True:
                client, _ = self._listening.accept()
                with client, contextlib.suppress(OSError):
                    self.clients += 1
                    self.request = client.recv(4096)
                    self._talk(client)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        self._thread.join(10.0)
        assert not self._thread.is_alive()


@contextlib.contextmanager
def server(answer):
    with Server(lambda client: client.sendall(answer)) as served:
        yield served


@pytest.mark.parametrize(
    "answer",
    [
        OK + b"Content-Length: 4\r\n\r\nJPEG",
        OK + b"\r\nJPEG",
        OK + b"content-length: 4\r\n\r\nJPEG and more than it said",
        b"HTTP/1.1 200 OK\r\nContent-Type: image/jpeg\r\nContent-Length: 4\r\n\r\nJPEG",
    ],
)
def test_picture_is_fetched(answer):
    with server(answer) as there:
        assert fetch(there.url) == b"JPEG"
        assert there.request.startswith(b"GET /1/0.jpg HTTP/1.0\r\n")
        assert f"Host: 127.0.0.1:{there.port}".encode() in there.request


def test_server_that_keeps_the_connection_open_is_not_waited_for():
    hold = threading.Event()

    def talk(client):
        client.sendall(OK + b"Content-Length: 4\r\n\r\nJPEG")
        hold.wait(10.0)

    with Server(talk) as there:
        assert fetch(there.url) == b"JPEG"
        hold.set()


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"\xff\xd8 no HTTP at all\r\n\r\n",
        b"HTTP/1.0 404 Not Found\r\n\r\n",
        b"HTTP/1.0 500 Oops\r\n\r\n",
        b"HTTP/1.0 200 OK\r\nX: " + b"x" * 70_000 + b"\r\n\r\n",
        OK + b"A: b\r\n" * 300 + b"\r\nJPEG",
        OK + b"Content-Length: 10\r\n\r\nJPEG",
        OK + b"Content-Length: -4\r\n\r\nJPEG",
        OK + b"Content-Length: 99999999999999999999999\r\n\r\nJPEG",
        OK + b"Content-Length: 999999999\r\n\r\nJPEG",
        OK + b"Transfer-Encoding: chunked\r\n\r\n4\r\nJPEG\r\n0\r\n\r\n",
        OK + b"Content-Encoding: gzip\r\n\r\nJPEG",
    ],
)
def test_answer_without_a_picture_is_a_link_error(answer):
    with server(answer) as there:
        with pytest.raises(LinkError, match="cannot be fetched") as caught:
            fetch(there.url)
        assert there.url in str(caught.value)


@pytest.mark.parametrize("location", ["file:///etc/hostname", "http://127.0.0.1:{port}/secret"])
def test_redirect_is_not_followed(location):
    with server(OK + b"\r\nsecret") as other:
        target = location.format(port=other.port).encode()
        with server(b"HTTP/1.0 302 Found\r\nLocation: " + target + b"\r\n\r\n") as there:
            with pytest.raises(LinkError, match="redirect, which is not followed"):
                fetch(there.url)
            assert (there.clients, other.clients) == (1, 0)


def test_reason_phrase_cannot_write_to_a_terminal():
    answer = b"HTTP/1.0 404 \x1b]0;owned\x07\x1b[31mred\r\n\r\n"
    with server(answer) as there, pytest.raises(LinkError) as caught:
        fetch(there.url)
    assert str(caught.value).endswith("HTTP 404 red")


@pytest.mark.parametrize(
    "url",
    [
        "", "sim://1/0.jpg", "file:///etc/hostname", "ftp://127.0.0.1/x", "http://[1/x",
        "http:///x", "http://127.0.0.1:99999/x", "http://127.0.0.1/a b", "gopher://127.0.0.1/x",
        "http://127.0.0.1/\r\nX: y", "http://127.0.0.1/\u202e.jpg", "HTTP:\x00//x",
    ],
)  # fmt: skip
def test_invalid_address_is_a_link_error(url):
    with pytest.raises(LinkError, match="cannot be fetched") as caught:
        fetch(url)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "host",
    [
        "localhost", "127.0.0.1", "0x7f000001", "2130706433", "127.1", "0.0.0.0", "[::1]",
        "[::ffff:127.0.0.1]", "camera@127.0.0.1", "192.0.2.7@127.0.0.1",
    ],
)  # fmt: skip
def test_host_not_named_gets_no_request(host):
    """A camera at 192.0.2.7 points the service at services of its own computer."""
    with server(OK + b"\r\nsecret") as there:
        with pytest.raises(
            LinkError, match=r"neither the vehicle's host nor named in camera\.hosts"
        ):
            fetch(f"http://{host}:{there.port}/latest/meta-data", "192.0.2.7")
        assert there.clients == 0


@pytest.mark.parametrize(
    ("host", "allowed"),
    [
        ("localhost", "127.0.0.1"),
        ("127.0.0.1", "localhost"),
        ("127.0.0.1", "::1"),
        ("127.0.0.1", "::ffff:127.0.0.1"),
        ("LOCALHOST", "localhost"),
    ],
)
def test_allowed_host_is_fetched_by_any_of_its_names(host, allowed):
    with server(OK + b"\r\nJPEG") as there:
        assert fetch(f"http://{host}:{there.port}/0.jpg", allowed) == b"JPEG"


def test_fetch_before_the_vehicle_answers_is_refused():
    with pytest.raises(LinkError, match="neither the vehicle's host"):
        fetch("http://127.0.0.1:1/0.jpg", "")


def test_host_without_a_server_is_a_link_error():
    with pytest.raises(LinkError, match="cannot be fetched"):
        fetch(f"http://127.0.0.1:{free_port()}/0.jpg")


@pytest.mark.parametrize("head", [b"", OK, OK + b"\r\n", OK + b"Content-Length: 9000\r\n\r\n"])
@pytest.mark.parametrize("speedup", [1.0, 20.0])
def test_slow_trickle_of_bytes_is_cut_off(head, speedup):
    """One limit holds for the whole download, in real seconds on any clock."""
    done = threading.Event()

    def talk(client):
        client.sendall(head)
        while not done.wait(0.02):
            client.sendall(b"H")

    with Server(talk) as there:

        async def main():
            with pytest.raises(LinkError, match=r"not done within 0\.3 s"):
                await PictureFetcher(lambda: LOOPBACK, 0.3)(there.url)

        begin_s = time.monotonic()
        run(main(), ScaledClock(speedup))
        assert time.monotonic() - begin_s > 0.29
        done.set()


def test_download_that_is_called_off_leaves_nothing_behind():
    asked, done = threading.Event(), threading.Event()

    def talk(client):
        asked.set()
        done.wait(10.0)

    with Server(talk) as there:

        async def main():
            task = asyncio.create_task(PictureFetcher(lambda: LOOPBACK)(there.url))
            await asyncio.to_thread(asked.wait, 10.0)
            task.cancel()
            await asyncio.wait([task])
            assert task.cancelled()

        asyncio.run(main())
        done.set()


def test_flood_of_bytes_is_cut_off(monkeypatch):
    monkeypatch.setattr(http_pictures, "MAX_PICTURE_BYTES", 100_000)

    def talk(client):
        client.sendall(OK + b"\r\n")
        while True:  # wait until the other end hangs up
            client.sendall(bytes(65_536))

    with Server(talk) as there, pytest.raises(LinkError, match="at most 100000 bytes"):
        fetch(there.url)


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="no /proc to count descriptors in")
def test_failed_fetches_leave_no_socket_open():
    before = len(os.listdir("/proc/self/fd"))
    with server(b"HTTP/1.0 404 Not Found\r\n\r\n") as there:
        for _ in range(5):
            with pytest.raises(LinkError):
                fetch(there.url)
    assert len(os.listdir("/proc/self/fd")) == before
