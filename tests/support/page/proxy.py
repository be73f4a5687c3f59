"""A proxy on loopback that records the hosts of a browser's requests, and forwards to loopback
only."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
from collections.abc import Iterator
from urllib.parse import urlsplit

LOOPBACK = ("127.0.0.1", "localhost", "::1")
BROWSERS_OWN = ("redirector.gvt1.com", "clients2.google.com")
"""Hosts that Chromium contacts for its own parts on any page; no switch forbids it."""
_HEAD_BYTES = 1 << 16


class RecordingProxy:
    """A proxy; `hosts` counts the requests and tunnels of each host."""

    @property
    def elsewhere(self) -> set[str]:
        """Return the hosts of other computers that a page has contacted."""
        return set(self.hosts) - {*LOOPBACK, *BROWSERS_OWN}

    def __init__(self) -> None:
        self.hosts: dict[str, int] = {}
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]

    def serve(self) -> None:
        while True:
            try:
                client, _ = self._listening.accept()
            except OSError:
                return  # closed
            threading.Thread(target=self._carry, args=(client,), daemon=True).start()

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()

    def _carry(self, client: socket.socket) -> None:
        with client, contextlib.suppress(OSError):
            head = b""
            while b"\r\n\r\n" not in head and len(head) < _HEAD_BYTES:
                if not (piece := client.recv(_HEAD_BYTES)):
                    return
                head += piece
            method, target, _ = head.split(b"\r\n", 1)[0].decode("latin-1").split(" ")
            url = urlsplit(target if "://" in target else f"//{target}")
            host = url.hostname or ""
            self.hosts[host] = self.hosts.get(host, 0) + 1
            if host not in LOOPBACK:
                client.sendall(b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\n\r\n")
                return
            with socket.create_connection((host, url.port or 80)) as server:
                if method == "CONNECT":
                    client.sendall(b"HTTP/1.1 200 Connected\r\n\r\n")
                else:
                    path = f"{url.path or '/'}{'?' + url.query if url.query else ''}"
                    lines = head.split(b"\r\n")
                    lines[0] = f"{method} {path} HTTP/1.1".encode("latin-1")
                    # one request a connection: the next one may be for another host
                    hops = b"connection:", b"proxy-connection:"
                    kept = [line for line in lines if not line.lower().startswith(hops)]
                    kept.insert(1, b"Connection: close")
                    server.sendall(b"\r\n".join(kept))
                _both_ways(client, server)


def _both_ways(client: socket.socket, server: socket.socket) -> None:
    with selectors.DefaultSelector() as waiting:
        waiting.register(client, selectors.EVENT_READ, server)
        waiting.register(server, selectors.EVENT_READ, client)
        while True:
            for key, _ in waiting.select():
                piece = key.fileobj.recv(1 << 16)  # type: ignore[union-attr]
                if not piece:
                    return
                key.data.sendall(piece)


@contextlib.contextmanager
def recording_proxy() -> Iterator[RecordingProxy]:
    proxy = RecordingProxy()
    thread = threading.Thread(target=proxy.serve, name="proxy")
    thread.start()
    try:
        yield proxy
    finally:
        proxy.close()
        thread.join()
