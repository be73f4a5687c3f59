"""A page is opened before a flight begins: what is wrong with it is said while nobody flies."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from uavmap.page.address import LOOPBACK, bound, need_nicegui
from uavmap.page.feed import Feed
from uavmap.page.pipe import Words


@dataclass(frozen=True, slots=True)
class Wishes:
    """How a page is served.

    Attributes:
        port: 0 for any that is free.
        option: How the port is given on the command line.
        host: The address that it is served on.
    """

    port: int
    option: str
    host: str = LOOPBACK


@contextlib.contextmanager
def opened(wishes: Wishes, config: Words, say: Callable[[str], None]) -> Iterator[Feed]:
    """A page, ready to be looked at, for as long as the context lasts; `say` tells where.

    Args:
        wishes: How it is served.
        config: What it shows: `title`; `steers`, whether there are buttons; `why` there are none;
            `timeline`, whether earlier times can be looked at; `frames`, the folder of the
            pictures; `pictures`, why there are none.
        say: Takes lines for the operator.

    Raises:
        UavmapError: NiceGUI is missing, or the port is taken.
    """
    need_nicegui()
    address = bound(wishes.host, wishes.port, wishes.option)
    url, served = address.url, {"token": address.token, "port": address.port}
    with address.listening:  # the page's process has its own from then on
        feed = Feed({**config, **served}, address.listening, say)
    try:
        feed.wait_ready()
        say(f"live page: {url}")
        if wishes.host != LOOPBACK:
            say("live page: whoever reaches this computer and has the token can give orders there")
        yield feed
    finally:
        feed.close()
