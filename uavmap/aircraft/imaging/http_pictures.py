"""Pictures that a camera serves over HTTP: from its own vehicle, whole, and in a bounded time.

The address of a picture comes over the air. Allowed are the host at the other end of the vehicle's
link and those of the mission (`camera.hosts`), and no redirect.
"""

from __future__ import annotations

import asyncio
import http.client
import io
import ipaddress
import ssl
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from missions.errors import LinkError
from uavmap.base.clock import wall_timeout
from uavmap.base.image_files import MAX_PICTURE_BYTES
from uavmap.base.printable import printable

FETCH_TIMEOUT_S: Final = 10.0
"""Maximum time of a download, real seconds."""
_MAX_HEAD_BYTES: Final = 65_536
_CHUNK_BYTES: Final = 65_536
_FOUND: Final = 200
_PORTS: Final = {"http": 80, "https": 443}


@dataclass(frozen=True, slots=True)
class _Address:
    scheme: str
    host: str
    port: int
    path: str

    @property
    def host_header(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return host if self.port == _PORTS[self.scheme] else f"{host}:{self.port}"


class PictureFetcher:
    """Fetches a picture by its URL from one of the allowed hosts. Raises `LinkError`.

    Args:
        allowed_hosts: Returns the names and addresses that are allowed now.
        timeout_s: Maximum time of a download, real seconds.
    """

    def __init__(
        self, allowed_hosts: Callable[[], Collection[str]], timeout_s: float = FETCH_TIMEOUT_S
    ) -> None:
        self._allowed_hosts = allowed_hosts
        self._timeout_s = timeout_s

    async def __call__(self, url: str) -> bytes:
        """Return the bytes at a URL."""
        shown = printable(url) or "a picture"
        try:
            address = _address(url)
            hosts = self._allowed_hosts()
            if _plain(address.host) not in {_plain(host) for host in hosts}:
                raise LinkError(
                    f"{address.host} is neither the vehicle's host nor named in camera.hosts"
                )
            async with wall_timeout(self._timeout_s):
                return await _download(address)
        except TimeoutError:
            reason = f"not done within {self._timeout_s:g} s"
        except (
            OSError,
            EOFError,  # a truncated answer
            asyncio.LimitOverrunError,
            http.client.HTTPException,
            ValueError,
            LinkError,
        ) as error:
            reason = printable(str(error)) or type(error).__name__
        raise LinkError(f"{shown} cannot be fetched: {reason}")


def _address(url: str) -> _Address:
    if not url.startswith(("http://", "https://")):
        raise LinkError("the camera names no http URL for its picture")
    if not url.isascii() or not url.isprintable() or " " in url:
        raise LinkError("a URL has no such characters")
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        raise LinkError("the camera names no http URL for its picture") from None
    if not host or "%" in host:
        raise LinkError("the URL names no host")
    path = parts.path or "/"
    return _Address(
        parts.scheme,
        host,
        _PORTS[parts.scheme] if port is None else port,
        f"{path}?{parts.query}" if parts.query else path,
    )


def _plain(host: str) -> str:
    """Return a host in a normal form: loopback has several names, an address several notations."""
    text = host.strip("[]").partition("%")[0].rstrip(".").lower()
    if text == "localhost":
        return "loopback"
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return text
    mapped = getattr(address, "ipv4_mapped", None)
    address = address if mapped is None else mapped
    return "loopback" if address.is_loopback else str(address)


async def _download(address: _Address) -> bytes:
    """GET by HTTP/1.0: the answer comes in one piece, and ends with the connection."""
    secure = ssl.create_default_context() if address.scheme == "https" else None
    reader, writer = await asyncio.open_connection(
        address.host, address.port, ssl=secure, limit=_MAX_HEAD_BYTES
    )
    try:
        writer.write(
            f"GET {address.path} HTTP/1.0\r\nHost: {address.host_header}\r\n"
            "Connection: close\r\nAccept: image/jpeg, image/png\r\n\r\n".encode("ascii")
        )
        await writer.drain()
        length = _length(await reader.readuntil(b"\r\n\r\n"))
        if length is not None:
            return await reader.readexactly(length)
        return await _to_the_end(reader)
    finally:
        writer.transport.abort()  # also when cancelled: do not wait for the other end


def _length(head: bytes) -> int | None:
    """Return the length of an answer. Raises `LinkError` for one without a picture."""
    status, _, fields = head.partition(b"\r\n")
    version, _, rest = status.decode("latin-1").partition(" ")
    code, _, phrase = rest.partition(" ")
    if not version.startswith("HTTP/1.") or not code.isdecimal():
        raise LinkError("the answer is not HTTP")
    if 300 <= int(code) < 400:
        raise LinkError(f"HTTP {int(code)}: a redirect, which is not followed")
    if int(code) != _FOUND:
        raise LinkError(f"HTTP {int(code)} {phrase}")
    headers = http.client.parse_headers(io.BytesIO(fields))
    if headers.get("Transfer-Encoding") or headers.get("Content-Encoding"):
        raise LinkError("the answer is encoded, which was not asked for")
    text = headers.get("Content-Length")
    if text is None:
        return None
    if not (text.isascii() and text.isdecimal() and len(text) < 20):
        raise LinkError("the answer has no length")
    if int(text) > MAX_PICTURE_BYTES:
        raise LinkError(f"{text} bytes; a picture has at most {MAX_PICTURE_BYTES}")
    return int(text)


async def _to_the_end(reader: asyncio.StreamReader) -> bytes:
    data = bytearray()
    while chunk := await reader.read(_CHUNK_BYTES):
        data += chunk
        if len(data) > MAX_PICTURE_BYTES:
            raise LinkError(f"a picture has at most {MAX_PICTURE_BYTES} bytes")
    return bytes(data)
