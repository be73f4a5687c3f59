"""The watch over aircraft after a mission: however it ends, they are taken care of.

    run_with_keeper(keeper, mission) -> what the mission returns

The keeper of the aircraft surrounds the mission. If the mission fails, it returns every vehicle in
the air. If the operator leaves at once, the autopilots do that, and the process ends only when it
is seen.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Mapping
from typing import Final, Protocol, TypeVar

from missions.errors import AircraftError, UavmapError, leaves
from uavmap.aircraft.guardian.guardian import Guardian

T = TypeVar("T")
NOT_HOME: Final = "an aircraft was not brought home"


class Keeper(Protocol):
    """Keeps watch over all aircraft of a flight."""

    async def run(self) -> None:
        """Watch until cancelled."""

    async def bring_home(self, reason: str) -> None:
        """Return, and wait until down."""

    async def leave(self, reason: str) -> None:
        """Return, and wait until that is seen."""

    def fates(self) -> Mapping[int, str]:
        """Return where each received aircraft is, as text, empty for one at home."""


class Guardians:
    """The guardians of several aircraft, by their numbers, as one keeper."""

    def __init__(self, guardians: Mapping[int, Guardian]) -> None:
        self._guardians = guardians

    async def run(self) -> None:
        """Watch until cancelled; one that fails ends it."""
        await asyncio.gather(*(guardian.run() for guardian in self._guardians.values()))

    async def bring_home(self, reason: str) -> None:
        """Return all, and wait until all are down, each independently of the others.

        Raises an `ExceptionGroup` of the guardians' failures.
        """

        async def bring_home(guardian: Guardian) -> None:
            try:
                await guardian.bring_home(reason)
            except Exception:
                await guardian.leave(reason)
                raise

        waits = map(bring_home, self._guardians.values())
        ended = await asyncio.gather(*waits, return_exceptions=True)
        if failures := [failure for failure in ended if isinstance(failure, Exception)]:
            raise ExceptionGroup(NOT_HOME, failures)

    async def leave(self, reason: str) -> None:
        """Return, and wait until that is seen."""
        waits = (guardian.leave(reason) for guardian in self._guardians.values())
        await asyncio.gather(*waits, return_exceptions=True)

    def fates(self) -> dict[int, str]:
        """Return where each received aircraft is, as text, empty for one at home."""
        return {
            number: fate
            for number, guardian in self._guardians.items()
            if (fate := guardian.fate()) is not None
        }


async def run_with_keeper(keeper: Keeper, mission: Awaitable[T], *, leave: bool) -> T:
    """Run a mission with the keeper of its aircraft around it.

    `leave`: an operator's interrupt leaves real aircraft to their autopilots; simulated ones end
    with the process. Raises the mission's error. After a failed mission it raises `AircraftError`,
    with each aircraft that is not at home. A defect of the program keeps its type, with these lines
    as notes. If one guardian fails, the others continue, and both failures are raised in a group.
    """
    keeping = asyncio.create_task(keeper.run())
    try:
        result = await run_beside_keeper(mission, keeping)
        await keeper.bring_home("the mission is over")
        return result
    except asyncio.CancelledError:
        if not leave:
            raise
        await _leave(keeper, "the operator left")
        _log_fates(keeper, "interrupted")
        raise
    except Exception as failure:
        reason = f"the mission failed ({failure_text(failure)})"
        try:
            await keeper.bring_home(reason)
        except asyncio.CancelledError:  # the operator does not wait for it
            await _leave(keeper, reason)
        except Exception as further:
            failure = ExceptionGroup(NOT_HOME, [failure, further])
        if is_defect(failure):  # it keeps its traceback
            for fate in _not_home(keeper):
                failure.add_note(fate)
            raise failure
        _log_fates(keeper, failure_text(failure))
        raise failure
    finally:
        keeping.cancel()
        await asyncio.gather(keeping, return_exceptions=True)


async def run_beside_keeper(mission: Awaitable[T], keeping: asyncio.Task[None]) -> T:
    """Return the mission's result; a keeper that fails ends the mission with its error."""
    flying = asyncio.ensure_future(mission)
    try:
        done, _ = await asyncio.wait([flying, keeping], return_when=asyncio.FIRST_COMPLETED)
        if keeping in done and flying not in done:
            keeping.result()
        return await flying
    finally:
        if not flying.done():
            flying.cancel()
            await asyncio.gather(flying, return_exceptions=True)


async def _leave(keeper: Keeper, reason: str) -> None:
    """Leave the aircraft to their autopilots; a further interrupt still shows their places."""
    with contextlib.suppress(asyncio.CancelledError):
        await keeper.leave(reason)


def is_defect(failure: Exception) -> bool:
    """Return whether the program itself failed, and not its environment."""
    found = leaves(failure) if isinstance(failure, BaseExceptionGroup) else [failure]
    return not all(isinstance(error, UavmapError) for error in found)


def _not_home(keeper: Keeper) -> list[str]:
    return [f"vehicle {n}: {fate}" for n, fate in sorted(keeper.fates().items()) if fate]


def _log_fates(keeper: Keeper, cause: str) -> None:
    if fates := _not_home(keeper):
        raise AircraftError("\n".join([cause, *fates]))


def failure_text(failure: BaseException) -> str:
    """Return a failure as one line."""
    if isinstance(failure, BaseExceptionGroup):
        return "; ".join(failure_text(error) for error in leaves(failure))
    return str(failure) or type(failure).__name__
