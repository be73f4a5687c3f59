"""The errors of the project, one tree: faults that a user can cause or correct.

Each prints one line and has exit code 2. A defect of the program is none of these: it keeps its
traceback.
"""

from __future__ import annotations


class UavmapError(Exception):
    """Base of every error whose cause is the input or the environment."""


class MissionFileError(UavmapError):
    """A mission file that cannot be flown; the text names the key."""


class GeodesyError(UavmapError):
    """A position outside the area where UTM is defined (80 S to 84 N)."""


class WorldError(UavmapError):
    """A file from which no simulated ground can be made, or one for another place."""


class ImageError(UavmapError):
    """A picture that cannot be used: no geotag, or not a readable image."""


class StrategyError(UavmapError):
    """An explorer that breaks its protocol: it jumps, never ends, or leaves all robots waiting."""


class RoiError(UavmapError):
    """A file from which no ROI can be read, or a ROI that cannot be generated."""


class LocalizationError(UavmapError):
    """A map without a possible position, an invalid rate, or an observation that fits no cell."""


class AreaError(UavmapError):
    """A file without a usable area, or options that do not fit the drawing."""


class StudyError(UavmapError):
    """A study that cannot run: an extra is not installed, or a scheduler does not answer."""


class JournalError(UavmapError):
    """A journal that cannot be opened, read or continued."""


class EventError(UavmapError, ValueError):
    """An event that cannot be recorded: a NaN, an infinity, a text that is no Unicode."""


class ResultsError(UavmapError):
    """A folder in which no map lies, or one that cannot be read."""


class OutputError(UavmapError):
    """A file that cannot be written: no folder, no permission, an unknown format."""


class PreflightError(UavmapError):
    """A mission that does not begin: a check failed, or the operator declined."""


class NotFlownError(PreflightError):
    """The end of a dry run; `could_fly` is True if the mission could have begun."""

    def __init__(self, text: str, *, could_fly: bool) -> None:
        super().__init__(text)
        self.could_fly = could_fly


class AircraftError(UavmapError):
    """A flight that ended with an aircraft down away from home, or left to its autopilot."""


class LinkError(UavmapError):
    """A URL that cannot be used, or a vehicle that is silent."""


class CommandRefusedError(LinkError):
    """A command that the vehicle denied; the text holds the vehicle's answer."""


def leaves(group: BaseExceptionGroup[BaseException]) -> list[BaseException]:
    """Return the single errors of a group, however nested.

    >>> leaves(BaseExceptionGroup("", [ExceptionGroup("", [LinkError("a")]), LinkError("b")]))
    [LinkError('a'), LinkError('b')]
    """
    found: list[BaseException] = []
    for error in group.exceptions:
        found += leaves(error) if isinstance(error, BaseExceptionGroup) else [error]
    return found
