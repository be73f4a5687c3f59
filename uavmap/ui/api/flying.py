"""Flights from Python: in the simulator, and with real aircraft."""

from __future__ import annotations

import contextlib
import dataclasses
import inspect
import logging
import os
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, Final, ParamSpec, cast

from missions.errors import UavmapError
from uavmap.base.arguments import Paths, choice, path_text, texts
from uavmap.base.messages import muted, shown_on
from uavmap.base.terminal import Terminal
from uavmap.journal.flight_plan import DRIVERS, KEY_VARIABLE, PYMAVLINK, Driver, FlightOptions
from uavmap.journal.results_folder import results_folder
from uavmap.photos.after_flight import draw_ground, kept_frames
from uavmap.runner import flight
from uavmap.runner.flight import planned
from uavmap.runner.ground_survey import with_ground
from uavmap.runner.operator.company import Company, Onlooker, Preflight
from uavmap.runner.operator.interrupts import Caller
from uavmap.runner.operator.progress import ProgressTable
from uavmap.ui.api.background_job import Job, run_async, run_blocking
from uavmap.ui.api.results import Results, open_results

P = ParamSpec("P")
_LOG: Final = logging.getLogger("uavmap.flight")


def fly(
    mission: Paths,
    *,
    sim: bool = False,
    connect: str | Sequence[str] = (),
    camera: str | Sequence[str] = (),
    vehicles: int | None = None,
    strategy: str | None = None,
    all_strategies: bool = False,
    detector: Paths | None = None,
    seed: int = 1,
    speedup: float | None = None,
    auto_swap: bool = False,
    driver: str = PYMAVLINK,
    onboard: bool = False,
    key: Paths | None = None,
    forward: str | Sequence[str] = (),
    yes: bool = False,
    dry_run: bool = False,
    keep_fence: bool = False,
    keep_frames: bool = False,
    out: Paths | None = None,
    quiet: bool = False,
) -> Results:
    """Fly a mission: search the box, explore the region, return, write the results.

    It does the same as `uavmap fly`, and returns when the flight is over. An event loop that runs
    already, as in a notebook, is blocked meanwhile; `fly_async` lets it continue.

    Ctrl-C, and "interrupt" in a notebook, returns real aircraft; a second time leaves that to their
    autopilots. `KeyboardInterrupt` is raised when they are at home or are seen to return. The
    results are in the folder, and `resume` continues.

    Args:
        mission: A mission file, or the name of a shipped mission such as `"runway"`.
        sim: Simulate the aircraft in this process, on virtual time.
        connect: The URL of each vehicle, such as `"udpin://0.0.0.0:14550"`. By default the URLs of
            the mission file.
        camera: The camera of each vehicle, as for `--camera`. By default the cameras of the mission
            file.
        vehicles: The number of vehicles, 1 to 50. By default that of the mission file, or of the
            URLs.
        strategy: The strategy, instead of the mission file's.
        all_strategies: With `sim`: allow also the strategies for comparisons with papers.
        detector: A name such as `"paved"`, or a folder made by `uavmap tune`, instead of the
            mission file's detector.
        seed: The seed of the simulation, 0 or more: the same seed gives the same flight.
        speedup: The speed, as a multiple of real time, 0.001 to 1000. By default as fast as
            possible with `sim`, else 1.
        auto_swap: Take off again with a fresh battery without a question; only for simulators.
        driver: The implementation of MAVLink: `"pymavlink"` or `"mavsdk"`.
        onboard: True if this computer flies with the vehicle.
        key: The file of a signing key. By default the file that `UAVMAP_KEY_FILE` names.
        forward: URLs of ground stations that get all MAVLink messages.
        yes: Take off without a question. Without it a person has to answer at a terminal, and a
            notebook has none. The bundled simulator needs no answer.
        dry_run: Do everything but arm. It raises `NotFlownError`, whose `could_fly` is the result.
        keep_fence: Keep fences and return heights of the autopilots.
        keep_frames: Keep each picture with its pose in the results.
        out: The folder of the results; by default a new one in `results`.
        quiet: Write nothing to standard error.

    Returns:
        The results. `completed` is False if a part of the mission is left; `aircraft_down` names
        aircraft that the crew has to fetch.

    Raises:
        MissionFileError: The mission file is wrong; file, key, value and remedy.
        LinkError: A URL is wrong, or a vehicle does not answer.
        PreflightError: A fault keeps the mission on the ground, or the answer was not yes.
        AircraftError: The flight failed with an aircraft that is not at home.
        UavmapError: Any other cause outside of the program; it is the base of all above.

    Examples:
        >>> fly("runwya", sim=True)
        Traceback (most recent call last):
        missions.errors.MissionFileError: runwya: cannot be read (No such file or directory); ...
    """
    return run_blocking(_flight(**locals()))


def resume(
    folder: Paths,
    *,
    connect: str | Sequence[str] = (),
    camera: str | Sequence[str] = (),
    driver: str | None = None,
    key: Paths | None = None,
    forward: str | Sequence[str] | None = None,
    from_home: bool = False,
    recall: bool = False,
    quiet: bool = False,
) -> Results:
    """Continue the mission of a folder, as `uavmap resume` does.

    This call allows real aircraft to take off, unless `recall` is given.

    Args:
        folder: The folder of the results.
        connect: The URL of each vehicle, if it has changed.
        camera: The camera of each vehicle, if it has changed.
        driver: The implementation of MAVLink from now on. By default as before.
        key: As for `fly`.
        forward: As for `fly`, if it has changed.
        from_home: In the simulator: start at home with full batteries.
        recall: Only return the vehicles in the air; none takes off.
        quiet: Write nothing to standard error.

    Returns:
        The results, as from `fly`.

    Raises:
        JournalError: The folder has no mission, or its journal is damaged.
        NotFlownError: No vehicle had flown. If its `could_fly` is true, the settings of the
            autopilots are restored.
        UavmapError: As from `fly`.
    """
    return run_blocking(_resumption(**locals()))


def _like(
    call: Callable[P, Results],
) -> Callable[[Callable[..., Awaitable[Results]]], Callable[P, Coroutine[Any, Any, Results]]]:
    """Give a coroutine the parameters of `call`, with their defaults."""
    signature = inspect.signature(call)

    def given(
        other: Callable[..., Awaitable[Results]],
    ) -> Callable[P, Coroutine[Any, Any, Results]]:
        @wraps(other)
        async def awaiting(*arguments: P.args, **options: P.kwargs) -> Results:
            bound = signature.bind(*arguments, **options)
            bound.apply_defaults()
            return await other(**bound.arguments)

        awaiting.__signature__ = signature  # type: ignore[attr-defined]
        return awaiting

    return given


@_like(fly)
async def fly_async(**options: Any) -> Results:
    """Fly as `fly` does, with the same arguments, while the program's event loop continues.

    A cancellation acts as Ctrl-C: the first returns real aircraft, the second leaves that to their
    autopilots. `asyncio.CancelledError` is raised only when they are at home or are seen to return:
    `asyncio.timeout` waits for them. If one is not, `AircraftError` is raised.

    Examples:
        >>> import asyncio
        >>> async def main() -> None:
        ...     async with asyncio.timeout(600.0):
        ...         flight = await fly_async("runway", sim=True)
        ...     print(flight.area_m2)
    """
    return await run_async(_flight(**options))


@_like(resume)
async def resume_async(**options: Any) -> Results:
    """Continue as `resume` does, while the program's event loop continues. See `fly_async`."""
    return await run_async(_resumption(**options))


# --- the jobs ------------------------------------------------------------------------------------
def _flight(mission: Paths, **given: Any) -> Job[Results]:
    sim, quiet, yes, dry_run = (given[key] for key in ("sim", "quiet", "yes", "dry_run"))
    if sim and given["connect"]:
        raise UavmapError("sim=True excludes connect=...; give one of them")
    if quiet and not (sim or yes or dry_run):
        raise UavmapError("quiet=True hides the question before take-off; add yes=True")
    detector = given["detector"]
    fields = {
        "mission_source": path_text("mission", mission),
        "simulated": sim,
        "urls": texts("connect", given["connect"]),
        "cameras": texts("camera", given["camera"]),
        "detector": None if detector is None else path_text("detector", detector),
        "key_file": None if sim else _key(given["key"]),
        "forward": texts("forward", given["forward"]),
    }
    named = {f.name: given[f.name] for f in dataclasses.fields(FlightOptions) if f.name in given}
    options = FlightOptions(**named | fields)
    out = None if given["out"] is None else path_text("out", given["out"])
    before = None if sim else Preflight(yes, dry_run, given["keep_fence"])
    if sim and dry_run:
        raise UavmapError("dry_run=True is for real aircraft; `uavmap check` looks at a mission")

    def job(caller: Caller) -> Results:
        with _shown(quiet=quiet) as onlookers:
            plan = with_ground(planned(options))
            name = plan.mission.name
            folder = results_folder(out, name)
            _LOG.info(f"{name} into {folder}; if it is interrupted: uavmap.resume")
            company = Company(onlookers=onlookers, preflight=before, caller=caller)
            flight.fly(plan, folder, company, keep_frames=given["keep_frames"])
            return _finished(folder)

    return job


def _resumption(folder: Paths, **given: Any) -> Job[Results]:
    where = Path(path_text("folder", folder))
    driver, forward = given["driver"], given["forward"]
    options = {
        "urls": texts("connect", given["connect"]),
        "cameras": texts("camera", given["camera"]),
        "driver": None if driver is None else cast(Driver, choice("driver", driver, DRIVERS)),
        "key_file": _key(given["key"]),
        "forward": None if forward is None else texts("forward", forward),
        "from_home": given["from_home"],
    }

    def job(caller: Caller) -> Results:
        with _shown(quiet=given["quiet"]) as onlookers:
            company = Company(onlookers=onlookers, caller=caller, recall=given["recall"])
            flight.resume(where, company, **options)
            return _finished(where)

    return job


def _finished(folder: Path) -> Results:
    """Return the results of a flight, with the boundary from its kept pictures."""
    results = open_results(folder)
    if results.aircraft_down:
        return results
    draw_ground(folder, _LOG.info)
    return open_results(folder) if kept_frames(folder) else results


@contextlib.contextmanager
def _shown(*, quiet: bool) -> Iterator[tuple[Onlooker, ...]]:
    """Show lines and progress on standard error, unless `quiet`; yield the onlookers."""
    if quiet:
        with muted():
            yield ()
        return
    terminal = Terminal()
    with shown_on(terminal):
        yield (ProgressTable(terminal),)


def _key(given: Paths | None) -> str | None:
    named = os.environ.get(KEY_VARIABLE) or None if given is None else path_text("key", given)
    return None if named is None else str(Path(named).expanduser().absolute())
