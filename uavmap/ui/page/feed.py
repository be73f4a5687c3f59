"""A process that shows a flight, on the side of the flight, which never waits for it.

While the queue of messages is full, messages are dropped; the next delta has all later changes.
"""

from __future__ import annotations

import contextlib
import importlib.util
import ipaddress
import logging
import os
import queue
import secrets
import select
import socket
import subprocess
import threading
import time
from collections.abc import Collection, Iterator
from typing import Final

from missions.errors import OutputError, UavmapError
from uavmap.base.child_process import Child
from uavmap.base.extras import install_command
from uavmap.ui.page.page_pipe import MAP_PATH, Lines, Message, packed

PORT: Final = 8470
LOOPBACK: Final = "127.0.0.1"


def need_nicegui() -> None:
    """Raise `UavmapError` where NiceGUI is missing."""
    if importlib.util.find_spec("nicegui") is None:
        raise UavmapError(f"the live page needs NiceGUI: {install_command('page')}")


def bind_port(host: str, port: int, option: str) -> socket.socket:
    """Bind a port and listen; 0 for any free port. `option` is the option of the port.

    Raises `OutputError` if the port is in use, or the host is not an address of this computer.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        # else the port of a page that has just ended stays in use for a minute
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(64)
    except (OSError, OverflowError) as error:
        listening.close()
        reason = getattr(error, "strerror", None) or error
        raise OutputError(
            f"{option}: the page cannot be served on {host} port {port} ({reason}); give another "
            f"port, or `{option} 0` for any free one"
        ) from None
    return listening


def url_host(host: str) -> str:
    """Return the host for a URL; for all addresses, the one at which others reach this computer."""
    with contextlib.suppress(ValueError):
        if not ipaddress.ip_address(host).is_unspecified:
            return f"[{host}]" if ":" in host else host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, contextlib.suppress(OSError):
        probe.connect(("192.0.2.1", 9))  # this sends nothing, and only chooses a network
        return str(probe.getsockname()[0])
    return LOOPBACK


_LOG: Final = logging.getLogger("uavmap.ui.page")
START_S: Final = 60.0
"""Maximum time until a process is ready, real s; a small computer needs about 3."""
END_S: Final = 6.0
"""Maximum time in which a process receives the last messages and ends, real s."""
WAITING: Final = 8
"""Maximum number of messages that wait to be written."""


class Feed:
    """A running process that shows a flight. A line is logged if it ends too early.

    Args:
        module: Module that the process runs.
        title: Its name in lines for the operator.
        config: Its first message.
        pass_fds: Open files that it inherits.
    """

    def __init__(
        self, module: str, title: str, config: Message, pass_fds: Collection[int] = ()
    ) -> None:
        self.title = title
        self._messages: queue.Queue[bytes | None] = queue.Queue(WAITING)
        self._lines = Lines()
        self.dead = self._logged = False
        self._child = Child(module, title, pass_fds)
        os.set_blocking(self.orders_file, False)
        self.put({"kind": "start", **config})
        self._writer = threading.Thread(target=self._write, name=title, daemon=True)
        self._writer.start()

    def wait_ready(self) -> None:
        """Wait until it is ready. Raises `OutputError` if it does not start."""
        due_s = time.monotonic() + START_S
        why = f"it was not ready within {START_S:g} s"
        while (left_s := due_s - time.monotonic()) > 0.0:
            select.select([self.orders_file], [], [], min(left_s, 0.5))
            ended = self._child.process.poll()
            # what follows the first line stays for others; of a process that has ended, all is read
            lines = self.orders(max_bytes=1) if ended is None else self.orders()
            if any(message.get("ready") for message in lines):
                return
            failed = [str(message["failed"]) for message in lines if "failed" in message]
            if failed or ended is not None:
                reasons = failed or [self._child.last_words(END_S)]
                why = reasons[0] or f"its process ended with {ended}"
                break
        raise OutputError(f"{self.title} does not start: {why}")

    # --- messages to it --------------------------------------------------------------------
    @property
    def idle(self) -> bool:
        """True if it has received nearly all messages."""
        return not self.dead and self._messages.qsize() <= 1

    def put(self, message: Message, data: bytes = b"", *, wait_s: float = 0.0) -> bool:
        """Queue a message; return whether the queue had room within `wait_s` real seconds."""
        if self.dead:
            self._log_end()
            return False
        try:
            self._messages.put(packed(message, data), wait_s > 0.0, wait_s or None)
        except queue.Full:
            return False
        return True

    def _write(self) -> None:
        pipe = self._child.stdin
        try:
            while (message := self._messages.get()) is not None:
                pipe.write(message)
                pipe.flush()
        except (OSError, ValueError):
            self.dead = True
        finally:
            with contextlib.suppress(OSError, ValueError):
                pipe.close()

    def _log_end(self) -> None:
        if not self._logged:
            self._logged = True
            why = self._child.last_words() or "its process has ended"
            _LOG.info(f"{self.title} has ended ({why}); the flight continues without it")

    # --- messages from it ------------------------------------------------------------------
    @property
    def orders_file(self) -> int:
        """File descriptor that is readable when there are orders."""
        return self._child.stdout.fileno()

    def orders(self, max_bytes: int = 1 << 16) -> list[Message]:
        """Return the orders since the last call; none from a process that has ended."""
        try:
            piece = os.read(self.orders_file, max_bytes)
        except BlockingIOError:
            return []
        except (OSError, ValueError):
            piece = b""
        if not piece:
            self.dead = True
        return self._lines.parse(piece)

    # --- end -------------------------------------------------------------------------------
    def close(self) -> list[Message]:
        """End the process after its last messages, at most `END_S`; return its last lines."""
        with contextlib.suppress(queue.Full):
            self._messages.put(None, timeout=0.0 if self.dead else END_S)
        self._writer.join(END_S)
        process = self._child.process
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        last = self.orders()
        self.dead = True
        self._child.close(END_S)
        return last


# --- the page is opened before a flight begins, so its errors come while no vehicle flies --------
@contextlib.contextmanager
def serve_page(config: Message, port: int, option: str, host: str = LOOPBACK) -> Iterator[Feed]:
    """Serve a page in the context; log its URL. Raises `UavmapError` without NiceGUI or the port.

    Args:
        config: The first message: `title`; `steers` for buttons, else `why` there are none;
            `timeline` for earlier times; `folder` of the results; `pictures`, why there are none.
        port: The port, 0 for any free one.
        option: The option of the port, for errors.
        host: The address at which the page is served.
    """
    need_nicegui()
    tokens = {name: secrets.token_urlsafe(16) for name in ("token", "map_token", "watch_token")}
    with bind_port(host, port, option) as listening:  # the page's process inherits its file
        port, number = listening.getsockname()[1], listening.fileno()
        served = {**tokens, "port": port, "socket": number}
        feed = Feed("uavmap.ui.page.page_child", "the live page", {**config, **served}, (number,))
    try:
        feed.wait_ready()
        address = f"http://{url_host(host)}:{port}"
        if config.get("steers"):
            _LOG.info(f"live page without buttons: {address}/?token={tokens['watch_token']}")
        _LOG.info(f"live page: {address}/?token={tokens['token']}")
        _LOG.info(f"map for a GIS: {address}{MAP_PATH}?token={tokens['map_token']}")
        if host != LOOPBACK:
            _LOG.info(
                "live page: each browser that reaches this computer and has the token can give "
                "orders"
            )
        yield feed
    finally:
        feed.close()
