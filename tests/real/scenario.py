"""The decorator that makes a test of a scenario: its aircraft are there, and its row is kept."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

import pytest

from tests.real.arducopter import ArduCopter
from tests.real.autopilot import Autopilot, NotSimulatedError, Values
from tests.real.figures import Row
from tests.real.px4 import Px4
from tests.real.rig import Rig

VARIABLES: Final = {"ardupilot": "UAVMAP_ARDUCOPTER", "px4": "UAVMAP_PX4"}
"""Environment variables with the paths of the programs."""
PROGRAMS: Final[Mapping[str, type[Autopilot]]] = {"ardupilot": ArduCopter, "px4": Px4}
_NONE: Final[Mapping[str, Values]] = MappingProxyType({})


def scenario(
    name: str, mission: str = "runway", *, near: bool = False, speed_m_s: float | None = None,
    parameters: Mapping[str, Values] = _NONE, only: str | None = None, shipped: bool = False,
) -> Callable[[Callable[[Rig], Awaitable[None]]], Callable[[str, Path, Path], None]]:  # fmt: skip
    """Make a test that flies a scenario.

    Args:
        name: Name in the table.
        mission: A shipped mission.
        near: Whether its search begins near the region.
        speed_m_s: Speed that replaces the mission's, m/s.
        parameters: Parameters of the owner, by autopilot.
        only: The one autopilot that can do this.
        shipped: Whether the mission flies as it is shipped; else it ends with the first patch, and
            is flown at the height of the map.
    """

    def decorated(flown: Callable[[Rig], Awaitable[None]]) -> Callable[[str, Path, Path], None]:
        def test(autopilot: str, program: Path, tmp_path: Path) -> None:
            if only not in (None, autopilot):
                pytest.skip(f"only with {only}")
            row = Row(autopilot, name)

            async def whole() -> None:
                async with Rig(
                    PROGRAMS[autopilot], program, tmp_path, row, mission, near=near,
                    speed_m_s=speed_m_s, parameters=parameters.get(autopilot, {}), shipped=shipped,
                ) as rig:  # fmt: skip
                    await flown(rig)

            try:
                asyncio.run(whole())
                row.right = True
            except NotSimulatedError as reason:
                pytest.skip(str(reason))
            except Exception as fault:
                row.detail = (str(fault) or repr(fault)).splitlines()[0]
                row.keep()
                raise
            row.keep()

        test.__doc__ = flown.__doc__
        return test

    return decorated
