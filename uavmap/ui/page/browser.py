"""A page is opened before a flight begins: what is wrong with it is said while nobody flies."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from uavmap.ui.page.address import LOOPBACK, bound, need_nicegui
from uavmap.ui.page.feed import Feed
from uavmap.ui.page.page_pipe import Words

_LOG: Final = logging.getLogger("uavmap.ui.page")


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
def opened(wishes: Wishes, config: Words) -> Iterator[Feed]:
    """A page, ready to be looked at, for as long as the context lasts; a line says where.

    Args:
        wishes: How it is served.
        config: What it shows: `title`; `steers`, whether there are buttons; `why` there are none;
            `timeline`, whether earlier times can be looked at; `frames`, the folder of the
            pictures; `pictures`, why there are none.

    Raises:
        UavmapError: NiceGUI is missing, or the port is taken.
    """
    need_nicegui()
    address = bound(wishes.host, wishes.port, wishes.option)
    url, served = address.url, {"token": address.token, "port": address.port}
    with address.listening:  # the page's process has its own from then on
        feed = Feed({**config, **served}, address.listening)
    try:
        feed.wait_ready()
        _LOG.info(f"live page: {url}")
        if wishes.host != LOOPBACK:
            _LOG.info(
                "live page: whoever reaches this computer and has the token can give orders there"
            )
        yield feed
    finally:
        feed.close()
