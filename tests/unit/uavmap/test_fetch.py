"""Pictures over HTTP: whatever the camera's server does, it is a picture or a `LinkError`."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import Iterator

import pytest

from missions.errors import LinkError
from uavmap.fly.http_pictures import fetch_over_http


@contextlib.contextmanager
def server(answer: bytes) -> Iterator[str]:
    """A server that sends these bytes to its first client and hangs up; its URL."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve() -> None:
            client, _ = listening.accept()
            with client, contextlib.suppress(OSError):  # the other end may hang up first
                client.recv(4096)
                client.sendall(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"http://127.0.0.1:{listening.getsockname()[1]}/1/0.jpg"
        thread.join(10.0)
        assert not thread.is_alive()


def test_a_picture() -> None:
    with server(b"HTTP/1.0 200 OK\r\nContent-Length: 4\r\n\r\nJPEG") as url:
        assert asyncio.run(fetch_over_http(url)) == b"JPEG"


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"\xff\xd8 no HTTP at all\r\n\r\n",
        b"HTTP/1.0 404 Not Found\r\n\r\n",
        b"HTTP/1.0 500 Oops\r\n\r\n",
        b"HTTP/1.0 200 OK\r\nX: " + b"x" * 70_000 + b"\r\n\r\n",
        b"HTTP/1.0 302 Found\r\nLocation: file:///etc/hostname\r\n\r\n",
    ],
)
def test_no_picture(answer: bytes) -> None:
    with server(answer) as url, pytest.raises(LinkError, match="cannot be fetched") as caught:
        asyncio.run(fetch_over_http(url))
    assert url in str(caught.value)


@pytest.mark.parametrize(
    "url",
    ["", "sim://1/0.jpg", "file:///etc/hostname", "ftp://127.0.0.1/x", "http://[1/x", "http:///x"],
)
def test_no_address(url: str) -> None:
    with pytest.raises(LinkError):
        asyncio.run(fetch_over_http(url))


def test_nobody_there() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with pytest.raises(LinkError, match="cannot be fetched"):
        asyncio.run(fetch_over_http(f"http://127.0.0.1:{port}/ 0.jpg"))
