"""Maps a region of unknown shape with one or more multicopters, over MAVLink.

    import uavmap

    flight = uavmap.fly("runway", sim=True)
    flight.region                                  # a shapely geometry, in longitude and latitude

The names below are loaded at their first use, so that importing `uavmap` costs nothing. They are
described in `uavmap.ui.api`; errors are those of `missions.errors`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from uavmap.base.version import __version__

if TYPE_CHECKING:
    from missions.errors import (
        AircraftError,
        AreaError,
        CommandRefusedError,
        GeodesyError,
        ImageError,
        JournalError,
        LinkError,
        LocalizationError,
        MissionFileError,
        NotFlownError,
        OutputError,
        PreflightError,
        ResultsError,
        RoiError,
        StrategyError,
        StudyError,
        UavmapError,
        WorldError,
    )
    from uavmap.lab.simulating import Simulated, simulate
    from uavmap.ui.api import (
        Results,
        fly,
        fly_async,
        open_results,
        replay,
        resume,
        resume_async,
    )

__all__ = [
    "AircraftError",
    "AreaError",
    "CommandRefusedError",
    "GeodesyError",
    "ImageError",
    "JournalError",
    "LinkError",
    "LocalizationError",
    "MissionFileError",
    "NotFlownError",
    "OutputError",
    "PreflightError",
    "Results",
    "ResultsError",
    "RoiError",
    "Simulated",
    "StrategyError",
    "StudyError",
    "UavmapError",
    "WorldError",
    "__version__",
    "fly",
    "fly_async",
    "open_results",
    "replay",
    "resume",
    "resume_async",
    "simulate",
]


_OF_LAB = ("Simulated", "simulate")


def __getattr__(name: str) -> Any:
    """Return a name of `__all__`, loaded now."""
    if name not in __all__:
        raise AttributeError(f"module 'uavmap' has no attribute {name!r}")
    if name.endswith("Error"):
        module = "missions.errors"
    else:
        module = "uavmap.lab.simulating" if name in _OF_LAB else "uavmap.ui.api"
    value = getattr(import_module(module), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
