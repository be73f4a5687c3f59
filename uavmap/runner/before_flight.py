"""Preflight over real links: examine, show, ask, set; and put back at the end of the flight."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Final

from missions.errors import LinkError, NotFlownError, OutputError, PreflightError
from missions.mission.layout import Layout
from uavmap.aircraft.cameras.spec import parse_camera
from uavmap.aircraft.imaging.classifier import detector_of
from uavmap.aircraft.process.messages import PreflightOptions
from uavmap.base.clock import ScaledClock, run
from uavmap.journal.flight_plan import FlightPlan
from uavmap.mavlink.vehicle_view import VehicleView
from uavmap.runner.flight_links import Link
from uavmap.runner.preflight.autopilot_setup import AutopilotSetup, SettingsFile
from uavmap.runner.preflight.examination import Examination, connect, open_answering_links
from uavmap.runner.preflight.finding import Finding, Level, binding, could_fly, for_vehicle, warn
from uavmap.runner.preflight.vehicle_check import pad_heights

_LOG: Final = logging.getLogger("uavmap.runner.preflight")
IDENTITY_S: Final = 2.0
"""Time to wait for the identity of a vehicle, which may be the bundled simulator, s."""
KEEP_FENCE: Final = "keep_fence"
"""Key of the journal's meta: whether the flight keeps the fences that are set."""
Ask = Callable[[str], Awaitable[bool | None]]
"""Asks the operator a question; None without an operator."""


class BeforeFlight:
    """The preflight of one flight. `wanted` is None for a resumed one, which asks nothing."""

    def __init__(
        self,
        wanted: PreflightOptions | None,
        setting: Layout,
        folder: Path,
        links: Sequence[Link],
        ask: Ask,
        *,
        keep_fence: bool = False,
    ) -> None:
        self._wanted = wanted
        self._ask_operator = ask
        self._setting = setting
        self._folder = folder
        self._keep_fence = keep_fence
        self._links = dict(enumerate(links, start=setting.member or 1))
        self._examinations = {
            number: Examination(number, link.session, link.camera)
            for number, link in self._links.items()
        }
        self._setups = {
            number: AutopilotSetup(number, link.session, setting, folder)
            for number, link in self._links.items()
        }

    async def prepare(self) -> None:
        """Return when the mission may begin.

        Raises `PreflightError` with the reason that prevents it, `NotFlownError` after a dry run,
        `LinkError`, `OutputError`.
        """
        if self._wanted is None:
            try:
                self._show(await self._set_up())
            except OutputError as error:  # others may be in the air: the flight continues without
                _LOG.info(str(error))
            return
        found = await self._examine()
        _LOG.info("\n".join(self._wanted.lines))
        self._show(self._not_refused(found))
        await self._ask(self._wanted, found)
        set_up = await self._set_up()
        self._show(self._not_refused(set_up))
        self._refuse(set_up)
        if self._wanted.dry_run:
            able = could_fly([*found, *set_up])
            text = "a dry run: nothing was armed; the mission could " + (
                "be flown" if able else "not be flown as it is"
            )
            if not await self.restore():
                able, text = False, f"{text}; what was set is not put back"
            self._setups.clear()  # the rest is left to `uavmap resume`
            raise NotFlownError(text, could_fly=able)

    async def restore(self) -> bool:
        """Restore each autopilot's settings; never raises. Return whether nothing is left."""
        return all(await asyncio.gather(*(setup.restore() for setup in self._setups.values())))

    # --- look ---------------------------------------------------------------------------------
    async def _examine(self) -> list[Finding]:
        parts = await asyncio.gather(*map(self._examined, self._links))
        standing = {n: self._view(n).pad_height for n in self._links if not self._view(n).armed}
        heights = pad_heights(self._setting, standing)
        found = [finding for part in parts for finding in part]
        return [*found, *(f for n, height in heights.items() for f in for_vehicle(n, [height]))]

    async def _examined(self, number: int) -> list[Finding]:
        setting, examination = self._setting, self._examinations[number]
        found = await examination.vehicle(setting)
        ratio = setting.mission.altitude_m(number - 1) / setting.mission.altitude_m(0)
        view = self._view(number)
        if not view.armed:
            detector = detector_of(setting.mission, ratio)
            found += await examination.camera(setting, detector, self._folder)
        else:  # its camera may be in use
            where = f"armed, {view.height_m:.0f} m up, in {view.mode_name}"
            wanted = "on the ground, motors off"
            remedy = "answer yes only if the mission is to take it over as it flies"
            found += for_vehicle(number, [warn("vehicle", where, wanted, remedy)])
        if self._keep_fence:
            found += for_vehicle(number, await self._setups[number].keep_fence())
        return found

    # --- ask ----------------------------------------------------------------------------------
    async def _ask(self, wanted: PreflightOptions, found: Sequence[Finding]) -> None:
        if wanted.dry_run:
            return
        self._refuse(found)
        simulated = [await self._is_simulator(number) for number in self._links]
        if all(simulated) or wanted.yes:
            return
        worse = sum(finding.level is not Level.OK for finding in found)
        answer = await self._ask_operator(f"{worse} findings above need attention; fly? [y/N]")
        if answer is None:
            raise PreflightError(
                "no operator at a terminal can confirm the flight; give --yes to fly without a "
                "question, or --dry-run to check only"
            )
        if not answer:
            raise PreflightError("not flown: the answer was no")

    def _refuse(self, found: Sequence[Finding]) -> None:
        """Raise `PreflightError` for findings that no operator can override."""
        rest = self._not_refused(found)
        if lines := [finding.line() for finding in found if finding not in rest]:
            raise PreflightError("not flown:\n" + "\n".join(lines))

    def _not_refused(self, found: Sequence[Finding]) -> Sequence[Finding]:
        if self._wanted is not None and self._wanted.dry_run:
            return found
        refused = list(binding(found))
        return [finding for finding in found if finding not in refused]

    async def _is_simulator(self, number: int) -> bool:
        view = self._view(number)
        session = self._links[number].session
        await session.until(lambda: view.identity is not None, IDENTITY_S)
        return view.is_simulator

    # --- set ----------------------------------------------------------------------------------
    async def _set_up(self) -> list[Finding]:
        """Set up each vehicle on the ground: nothing is changed on one that flies."""
        numbers = [] if self._keep_fence else self._links
        standing = [number for number in numbers if not self._view(number).armed]
        others = [setup for number, setup in self._setups.items() if number not in standing]
        await asyncio.gather(*(setup.save_timeout() for setup in others))
        parts = await asyncio.gather(*(self._setups[number].apply() for number in standing))
        return [
            finding
            for number, part in zip(standing, parts, strict=True)
            for finding in for_vehicle(number, part)
        ]

    # --- words --------------------------------------------------------------------------------
    def _show(self, found: Sequence[Finding]) -> None:
        if found:
            _LOG.info("\n".join(finding.line() for finding in found))

    def _view(self, number: int) -> VehicleView:
        return self._links[number].session.view


# --- what a flight left set: a vehicle was silent at its end, `uavmap resume` puts it back --------
def is_left_set(folder: Path) -> bool:
    """Return whether a flight of this folder has left something set on an autopilot."""
    return not SettingsFile(folder).empty


def put_back(plan: FlightPlan, setting: Layout, folder: Path) -> bool:
    """Connect to the vehicles and restore their settings; return whether nothing is left to do."""
    run(_put_back(plan, setting, folder), ScaledClock(plan.speedup or 1.0))
    return not is_left_set(folder)


async def _put_back(plan: FlightPlan, setting: Layout, folder: Path) -> None:
    cameras = [parse_camera("mavlink")] * len(plan.urls)
    async with open_answering_links(plan, cameras, setting.mission.camera) as links:
        numbered = enumerate(links, start=setting.member or 1)
        await asyncio.gather(*(_one(n, link, setting, folder) for n, link in numbered))


async def _one(number: int, link: Link, setting: Layout, folder: Path) -> None:
    setup = AutopilotSetup(number, link.session, setting, folder)
    try:
        await connect(link.session, link.name)
    except LinkError as error:
        _LOG.info(f"vehicle {number}: {error}")
        return
    if await setup.restore():
        _LOG.info(f"vehicle {number}: has its own settings")
