"""Maps a region of unknown shape with one or more multicopters, over MAVLink.

    import uavmap

    flight = uavmap.fly("runway", sim=True)
    flight.region                                  # a shapely geometry, in longitude and latitude

The names below are loaded when they are first used, so that importing `uavmap` costs nothing.
What they are is in `uavmap.api`; errors are those of `missions.errors`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

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
    from uavmap.api import (
        Results,
        Simulated,
        fly,
        fly_async,
        open_results,
        replay,
        resume,
        resume_async,
        simulate,
    )

__version__ = "0.1.0"

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

_CALLABLE_PACKAGE: Final = "fly"
"""`uavmap.fly` is the package of that name, which can be called: see `uavmap.fly`."""


def __getattr__(name: str) -> Any:
    """A name of `__all__`, loaded now."""
    if name not in __all__:
        raise AttributeError(f"module 'uavmap' has no attribute {name!r}")
    if name == _CALLABLE_PACKAGE:
        return import_module("uavmap.fly")
    module = "missions.errors" if name.endswith("Error") else "uavmap.api"
    value = getattr(import_module(module), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
