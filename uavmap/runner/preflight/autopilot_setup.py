"""The settings of one vehicle's autopilot for a mission, and their restoration.

The old settings are on disk until they are restored, for `uavmap resume` if this computer fails.
Every setting is read back.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import logging
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from missions.errors import LinkError, OutputError
from missions.mission.layout import Layout
from missions.units import LatLon
from uavmap.base.atomic_write import write_text
from uavmap.mavlink.autopilots import PX4
from uavmap.mavlink.mission_transfer import Item, Kind, MissionTransfer, same_items
from uavmap.mavlink.parameters import Parameter, Parameters
from uavmap.mavlink.session import Session
from uavmap.output.formats.ground_station_plan import Firmware, plan_text
from uavmap.runner.preflight.autopilot_fence import (
    ARDUPILOT_FENCE,
    PX4_FENCE,
    FencePlan,
    VehicleFence,
)
from uavmap.runner.preflight.finding import Finding, bad, ok, warn

_LOG: Final = logging.getLogger("uavmap.runner.preflight")
FILE: Final = "autopilot-before.json"
RESTORE_S: Final = 60.0
"""Maximum time for the restore at the end of a flight, s."""
MAX_SILENCE_S: Final = 5.0
IDENTITY_TRIES: Final = 5
IDENTITY_S: Final = 1.0
"""Wait for each answer to the request for the aircraft's identity, s."""
_KEEP: Final = "give --keep-fence to fly inside the fence that is set"
Items = tuple[Item, ...]


@dataclass(frozen=True, slots=True)
class EarlierSettings:
    """The old settings of one autopilot; None: its lists are not changed."""

    parameters: dict[str, Parameter]
    fence: Items | None = None
    rally: Items | None = None


class SettingsFile:
    """The file in a results folder, by the identity of the aircraft: a spare has its own entry."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE

    @property
    def empty(self) -> bool:
        """True if nothing is to be restored."""
        return not self.path.exists()

    def earlier(self, aircraft: str) -> EarlierSettings | None:
        """Return an aircraft's old settings, None once they are restored. Raises `OutputError`."""
        values = self._read().get(aircraft)
        if values is None:
            return None
        try:
            return EarlierSettings(
                {name: Parameter(float(v), int(t)) for name, (v, t) in values["set"].items()},
                _items(values["fence"]),
                _items(values["rally"]),
            )
        except (KeyError, TypeError, ValueError):
            raise self._unreadable() from None

    def keep(self, aircraft: str, number: int, before: EarlierSettings) -> None:
        """Save the settings of the aircraft of vehicle `number` before a change. Raises
        `OutputError`."""
        values = self._read()
        values[aircraft] = {
            "vehicle": number,
            "set": {name: [p.value, p.type] for name, p in before.parameters.items()},
            "fence": _plain(before.fence),
            "rally": _plain(before.rally),
        }
        self._write(values)

    def forget(self, aircraft: str) -> None:
        """Remove the settings of a restored aircraft. Raises `OutputError`."""
        values = self._read()
        if values.pop(aircraft, None) is not None:
            self._write(values)

    def in_place_of(self, number: int) -> list[str]:
        """Return the aircraft of vehicle `number` that are not restored. Raises `OutputError`."""
        return [key for key, value in self._read().items() if value.get("vehicle") == number]

    def _read(self) -> dict[str, Any]:
        try:
            values = json.loads(self.path.read_text("utf-8"))
        except FileNotFoundError:
            return {}
        except (OSError, ValueError):
            raise self._unreadable() from None
        if not isinstance(values, dict) or not all(isinstance(v, dict) for v in values.values()):
            raise self._unreadable()
        return values

    def _unreadable(self) -> OutputError:
        return OutputError(
            f"{self.path} cannot be read; it holds the settings of the autopilots before the "
            "flight: set them by hand, and remove the file"
        )

    def _write(self, values: dict[str, Any]) -> None:
        try:
            if values:
                write_text(self.path, json.dumps(values, indent=1) + "\n")
            else:
                self.path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"{self.path} cannot be written: {error.strerror}") from None


def _plain(items: Items | None) -> list[list[float]] | None:
    if items is None:
        return None
    return [
        [i.command, i.frame, i.first, i.position.lat_deg, i.position.lon_deg, i.height_m]
        for i in items
    ]


def _items(rows: list[list[float]] | None) -> Items | None:
    if rows is None:
        return None
    return tuple(
        Item(int(command), LatLon(lat, lon), first, int(frame), height)
        for command, frame, first, lat, lon, height in rows
    )


class AutopilotSetup:
    """The settings of one autopilot for a flight, and the old ones."""

    def __init__(self, number: int, session: Session, setting: Layout, folder: Path) -> None:
        self._number = number
        self._session = session
        self._view = session.view
        self._setting = setting
        self._folder = folder
        self._kept = SettingsFile(folder)
        self._parameters = Parameters(session)
        self._transfer = MissionTransfer(session)
        self._unnamed = False
        """True if it has reported no hardware number."""

    # --- as it is -----------------------------------------------------------------------------
    async def examine(self) -> tuple[EarlierSettings, list[Finding]]:
        """Return the present settings, with findings on them. Raises `LinkError`."""
        names = PX4_FENCE if self._view.kind is PX4 else ARDUPILOT_FENCE
        parameters = await self._parameters.read_many([*names, *self._timeout])
        found: list[Finding] = []
        lists: dict[Kind, Items] = {}
        for kind in Kind:
            try:
                lists[kind] = await self._transfer.download(kind)
            except LinkError as error:
                lists[kind] = ()
                found.append(warn(kind.words, str(error), "an answer", "is it an old firmware?"))
        return EarlierSettings(parameters, lists[Kind.FENCE], lists[Kind.RALLY]), found

    @property
    def _timeout(self) -> tuple[str, ...]:
        """Return the parameter that a stream of setpoints shortens in the flight, if it has one."""
        name = self._view.kind.stream_timeout
        return () if name is None else (name,)

    async def keep_fence(self) -> list[Finding]:
        """Return findings whether the mission fits inside the fence that is set. Raises
        `LinkError`."""
        before, found = await self.examine()
        faults = self.fence_of(before).faults(before.fence or ())
        found += [
            bad(
                "fence", f"the mission leaves the one that is set: {fault}", "a mission inside",
                "fly without --keep-fence, change the mission, or change the fence", binding=True,
            )
            for fault in faults
        ]  # fmt: skip
        return found if faults else [*found, ok("fence", f"kept: {self.settings_text(before)}")]

    def settings_text(self, before: EarlierSettings) -> str:
        """Return an autopilot's settings as text."""
        values = " ".join(f"{name}={p.value:g}" for name, p in before.parameters.items())
        points = f"{len(before.fence or ())} items, {len(before.rally or ())} rally points"
        return f"{points}, {values or 'no parameters reported'}"

    def fence_of(self, before: EarlierSettings) -> VehicleFence:
        """Return the fence for the mission, by the old settings."""
        values = {name: parameter.value for name, parameter in before.parameters.items()}
        return VehicleFence(self._setting, self._number, self._home, self._view.kind, values)

    @property
    def _home(self) -> LatLon:
        """Return the vehicle's position: it becomes its home when it arms."""
        return self._view.position or self._view.home or self._setting.mission.home

    # --- set ----------------------------------------------------------------------------------
    async def apply(self) -> list[Finding]:
        """Set fence, rally point and return height, and read them back; a failure is a finding.

        Raises `OutputError`, and changes nothing, if the old values cannot be saved.
        """
        try:
            before, found = await self.examine()
            plan = self.fence_of(before).plan()
            self._note(await self._aircraft(), before, plan)
            await self._put(Kind.FENCE, plan.fence)
            await self._put(Kind.RALLY, plan.rally)
        except LinkError as error:
            return [bad("fence", str(error), "the mission's fence", _KEEP, binding=True)]
        found += _left_out(plan)
        failed = [
            bad(name, "could not be set", f"{value:g}", f"set it by hand, or {_KEEP}", binding=True)
            for name, value in plan.parameters.items()
            if not await self._set(name, value, before.parameters.get(name))
        ]
        if failed:
            return found + failed
        values = " ".join(f"{name}={value:g}" for name, value in plan.parameters.items())
        text = f"set and read back, {plan.outside_m:.0f} m outside of the mission's; {values}"
        return [*found, ok("fence", text)]

    async def save_timeout(self) -> None:
        """Save the parameter that setpoints change, if nothing else is set. Raises
        `OutputError`."""
        aircraft = await self._aircraft()
        if self._kept.earlier(aircraft) is None and (
            found := await self._parameters.read_many(self._timeout)
        ):
            self._kept.keep(aircraft, self._number, EarlierSettings(found))

    async def _aircraft(self) -> str:
        """Return the hardware's number and system id (simulators side by side share the first).

        For an aircraft that does not answer in time, it is the number in the mission.
        """
        view, session = self._view, self._session
        for _ in range(IDENTITY_TRIES):
            if view.identity is not None or self._unnamed:
                break
            session.request(mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
            await session.until(
                lambda: view.identity is not None, max(IDENTITY_S, session.ack_wait_s)
            )
        self._unnamed = self._unnamed or not view.uid
        return f"vehicle {self._number}" if self._unnamed else f"{view.uid} {view.system_id}"

    def _note(self, aircraft: str, before: EarlierSettings, plan: FencePlan) -> None:
        """Save the old settings on disk, once: later ones are our own."""
        kept = self._kept.earlier(aircraft)
        if kept is not None and kept.fence is not None:
            return
        fence, rally = before.fence or (), before.rally or ()
        same = same_items(plan.fence, fence) and same_items(plan.rally, rally)
        if (fence or rally) and not same:
            self._write_plan(before, fence, rally)
        names = (*plan.parameters, *self._timeout)
        changed = {name: p for name, p in before.parameters.items() if name in names}
        if kept is not None:
            changed |= kept.parameters
        self._kept.keep(
            aircraft, self._number, EarlierSettings(changed, before.fence, before.rally)
        )

    def _write_plan(self, before: EarlierSettings, fence: Items, rally: Items) -> None:
        path = _unused(self._folder / f"fence-before-{self._number}.plan")
        firmware = Firmware.PX4 if self._view.kind is PX4 else Firmware.ARDUPILOT
        try:
            write_text(path, plan_text(firmware, self._home, fence, rally))
        except OSError as error:
            raise OutputError(f"{path} cannot be written: {error.strerror}") from None
        self._log(
            f"the fence that was set ({self.settings_text(before)}) is in {path}, and is put back "
            "at the end"
        )

    async def _put(self, kind: Kind, items: Items) -> None:
        await self._transfer.upload(kind, items)
        if not same_items(items, await self._transfer.download(kind)):
            raise LinkError(f"{kind.words} were read back differently")

    async def _set(self, name: str, value: float, found: Parameter | None) -> bool:
        if found is None:
            return False
        if found.value == value:
            return True
        return await self._parameters.write(name, Parameter(value, found.type))

    # --- and back -----------------------------------------------------------------------------
    async def restore(self) -> bool:
        """Restore the old settings, on the ground; else log which stay set. Never raises.

        Return whether nothing is left to restore.
        """
        try:
            if self._kept.empty:
                return True
            aircraft = await self._aircraft()
            before = self._kept.earlier(aircraft)
            if before is not None:
                if reason := await self._not_now():
                    self._log_left(reason)
                    return False
                async with asyncio.timeout(RESTORE_S):
                    await self._put_back(before)
                self._kept.forget(aircraft)
            others = self._kept.in_place_of(self._number)
        except (LinkError, OutputError, TimeoutError) as error:
            self._log_left(str(error) or "it takes too long")
            return False
        if others:
            self._log(
                f"{self._kept.path} keeps the settings of an aircraft that is not connected; "
                f"connect it, and `{self._resume}` puts them back"
            )
        return not others

    async def _put_back(self, before: EarlierSettings) -> None:
        for name, parameter in before.parameters.items():
            if not await self._parameters.write(name, parameter):
                raise LinkError(f"{name} could not be set back to {parameter.value:g}")
        for kind, items in ((Kind.FENCE, before.fence), (Kind.RALLY, before.rally)):
            if items is not None:
                await self._put(kind, items)

    def _log(self, text: str) -> None:
        _LOG.info(f"vehicle {self._number}: {text}")

    async def _not_now(self) -> str:
        view, patience_s = self._view, max(MAX_SILENCE_S, 2.0 * self._session.ack_wait_s)
        if asyncio.get_running_loop().time() - view.received_s > patience_s:
            return "it is silent"
        if view.armed:
            return "its motors are armed"
        # it may have disarmed a moment ago, after a crash
        await self._session.until(lambda: view.on_ground, patience_s)
        return "" if view.on_ground else "it has not reported that it is on the ground"

    def _log_left(self, reason: str) -> None:
        self._log(
            f"the settings of the mission stay ({reason}); those before it are in "
            f"{self._kept.path}, and `{self._resume}` restores them; with --recall "
            "nothing takes off"
        )

    @property
    def _resume(self) -> str:
        return f"uavmap resume {shlex.quote(str(self._folder))}"


def _unused(path: Path) -> Path:
    """Return the path, or that with a number if it exists: of another aircraft."""
    names = (path.with_stem(f"{path.stem}-{n}") for n in itertools.count(2))
    return path if not path.exists() else next(name for name in names if not name.exists())


def _left_out(plan: FencePlan) -> list[Finding]:
    found, narrow = [], f"narrower than {2 * plan.outside_m:.0f} m: the autopilot does not know"
    if plan.holes_left_out:
        found_text = f"{plan.holes_left_out} are {narrow} them"
        remedy = "the mission keeps out of them all the same"
        found.append(warn("fence.holes", found_text, "wider holes", remedy))
    if plan.columns_left_out:
        s = "s" if len(plan.columns_left_out) > 1 else ""
        owners = f"vehicle{s} {', '.join(map(str, plan.columns_left_out))}"
        found_text = f"the air over the pad{s} of {owners} is {narrow} it"
        found.append(warn("fence", found_text, "", "the mission keeps out of it all the same"))
    return found
