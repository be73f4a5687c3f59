"""A limit in real seconds on a loop whose own time may be faster."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from typing import Final

_STEP_S: Final = 0.2


@contextlib.asynccontextmanager
async def wall_timeout(seconds: float) -> AsyncIterator[None]:
    """As `asyncio.timeout`, in real seconds: a server does not answer faster with `--speedup`."""
    loop = asyncio.get_running_loop()
    end_s = time.monotonic() + seconds
    handle: asyncio.Handle | None = None
    async with asyncio.timeout(None) as limit:

        def look() -> None:
            nonlocal handle
            left_s = end_s - time.monotonic()
            if left_s <= 0.0:
                limit.reschedule(loop.time())
            else:  # on a fast clock it is too early then, and looks again
                handle = loop.call_later(min(max(left_s, _STEP_S), 1.0), look)

        look()
        try:
            yield
        finally:
            if handle is not None:
                handle.cancel()
