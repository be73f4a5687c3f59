"""However a mission ends, its aircraft are looked after before the process ends.

    watched_over(guardians, mission) -> what the mission returns

The guardians live around the mission: when it fails, they bring home whoever is in the air; when
the operator leaves at once, the autopilots do, and that is seen before the process ends.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Sequence
from typing import Protocol, TypeVar

from missions.errors import AircraftError, UavmapError, leaves

T = TypeVar("T")


class Keeper(Protocol):
    """What is needed of a guardian."""

    async def run(self) -> None:
        """Watch until cancelled."""
        ...

    async def bring_home(self, reason: str) -> None:
        """Return, and wait until down."""
        ...

    async def leave(self, reason: str) -> None:
        """Return, and wait until that is seen."""
        ...

    def fate(self) -> str:
        """Where the aircraft is at the end, empty if at home."""
        ...


async def watched_over(guardians: Sequence[Keeper], mission: Awaitable[T], *, leave: bool) -> T:
    """Run a mission with its guardians around it.

    `leave`: whether real aircraft have to be left when the operator interrupts; simulated ones end
    with the process.

    Raises what the mission raises; `AircraftError`, naming every aircraft that is not at home, when
    one was left in the air or is down elsewhere after a mission that failed. A defect of the
    program stays what it is, with these lines as its notes. Where one guardian fails, its aircraft
    is left to its autopilot, the others go on, and both failures are raised in a group.
    """
    keeping = [asyncio.create_task(guardian.run()) for guardian in guardians]
    try:
        result = await _or_guardian_failed(mission, keeping)
        if not_home := await _brought_home(guardians, "the mission is over"):
            raise ExceptionGroup("an aircraft was not brought home", not_home)
        return result
    except asyncio.CancelledError:
        if not leave:
            raise
        await _left(guardians, "the operator left")
        _say_fates(guardians, "interrupted")
        raise
    except Exception as failure:
        reason = f"the mission failed ({_in_words(failure)})"
        failures: list[Exception] = []
        try:
            failures = await _brought_home(guardians, reason)
        except asyncio.CancelledError:  # the operator does not wait for it
            await _left(guardians, reason)
        if failures:
            failure = ExceptionGroup("an aircraft was not brought home", [failure, *failures])
        if _is_defect(failure):  # which keeps its traceback
            for fate in _fates(guardians):
                failure.add_note(fate)
            raise failure
        _say_fates(guardians, _in_words(failure))
        raise failure
    finally:
        for task in keeping:
            task.cancel()
        await asyncio.gather(*keeping, return_exceptions=True)


async def _or_guardian_failed(mission: Awaitable[T], keeping: Sequence[asyncio.Task[None]]) -> T:
    """The mission's result; a guardian that fails ends the mission, loudly."""
    flying = asyncio.ensure_future(mission)
    try:
        done, _ = await asyncio.wait([flying, *keeping], return_when=asyncio.FIRST_COMPLETED)
        for task in keeping:
            if task in done and flying not in done:
                task.result()
        return await flying
    finally:
        if not flying.done():
            flying.cancel()
            await asyncio.gather(flying, return_exceptions=True)


async def _brought_home(guardians: Sequence[Keeper], reason: str) -> list[Exception]:
    """Bring all home, each whatever becomes of the others. Returns the guardians' failures."""

    async def bring_home(guardian: Keeper) -> None:
        try:
            await guardian.bring_home(reason)
        except Exception:
            await guardian.leave(reason)
            raise

    ended = await asyncio.gather(*map(bring_home, guardians), return_exceptions=True)
    return [failure for failure in ended if isinstance(failure, Exception)]


async def _left(guardians: Sequence[Keeper], reason: str) -> None:
    """Leave the aircraft to their autopilots; who is in such a hurry that this is not seen either
    still is told where they are."""
    with contextlib.suppress(asyncio.CancelledError):
        await asyncio.gather(
            *(guardian.leave(reason) for guardian in guardians), return_exceptions=True
        )


def _fates(guardians: Sequence[Keeper]) -> list[str]:
    """A line for every aircraft that is not at home."""
    return [
        f"vehicle {number}: {fate}"
        for number, guardian in enumerate(guardians, start=1)
        if (fate := guardian.fate())
    ]


def _is_defect(failure: Exception) -> bool:
    """Whether the program itself failed, and not something around it."""
    found = leaves(failure) if isinstance(failure, BaseExceptionGroup) else [failure]
    return not all(isinstance(error, UavmapError) for error in found)


def _say_fates(guardians: Sequence[Keeper], cause: str) -> None:
    """Raise `AircraftError` when an aircraft is not at home."""
    if fates := _fates(guardians):
        raise AircraftError("\n".join([cause, *fates]))


def _in_words(failure: BaseException) -> str:
    """A failure in one line."""
    if isinstance(failure, BaseExceptionGroup):
        return "; ".join(_in_words(error) for error in leaves(failure))
    return str(failure) or type(failure).__name__
