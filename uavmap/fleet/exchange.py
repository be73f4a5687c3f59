"""A member talks while its flight lasts, and after it until the others know all of it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator
from typing import Final

from uavmap.fleet.member import BEAT_S, Member

_LOG: Final = logging.getLogger("uavmap.fleet")
LINGER_S: Final = 600.0
"""So long after its landing a member waits for others that still fly."""
LINGER_APART_S: Final = 120.0
"""... and so long for those of them that are out of contact."""


@contextlib.asynccontextmanager
async def talking(member: Member | None, *, may_leave: bool = False) -> AsyncIterator[None]:
    """Let a member talk in the context, and after it until the others know all of it.

    `may_leave`: an operator may end that wait; its cancellation is no failure then.
    """
    if member is None:
        yield
        return
    task = asyncio.create_task(member.run())
    try:
        yield
        if may_leave and not member.level:
            _LOG.info(
                "ours is done; waiting for what the others of the fleet still find (Ctrl-C ends it)"
            )
        try:
            await _settle(member)
        except asyncio.CancelledError:
            waiting = asyncio.current_task()
            if not may_leave or waiting is None:
                raise
            waiting.uncancel()
            _LOG.info(
                "not waiting for the others: their journals hold what they find, for uavmap merge"
            )
    finally:
        task.cancel()
        member.end()
        await asyncio.gather(task, return_exceptions=True)


async def _settle(member: Member) -> None:
    """Wait, within bounds, until all in contact are done and know what is known here.

    A member out of contact that was not done comes home, where it hears us.
    """
    waited_s = 0.0
    while waited_s < LINGER_S:
        least_s = 2.0 * BEAT_S if member.all_done else LINGER_APART_S
        if member.level and waited_s >= least_s:
            break
        await asyncio.sleep(BEAT_S)
        waited_s += BEAT_S
