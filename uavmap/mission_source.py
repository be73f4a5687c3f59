"""Mission files on the disk, and those that are shipped."""

from __future__ import annotations

import contextlib
import difflib
import itertools
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Final

from missions.errors import MissionFileError
from missions.mission_file.checks import STRATEGIES, parse_mission
from missions.mission_file.schema import Mission
from uavmap.dem import with_terrain
from uavmap.detector_source import (
    check_detector,
    detector_of_section,
    known_detectors,
    with_detector,
    with_model,
)
from uavmap.prior_file import with_prior
from uavmap.text_files import read_text

LARGEST_BYTES: Final = 4_000_000
_MOST_LOOKED_AT: Final = 1000


@dataclass(frozen=True, slots=True)
class MissionSource:
    """The text of a mission and where it came from."""

    source: str
    text: str

    def parse(self) -> Mission:
        """The checked mission. Raises `MissionFileError`."""
        mission = parse_mission(
            self.text, self.source, strategies=STRATEGIES, detectors=known_detectors()
        )
        try:
            check_detector(mission.detector)
        except MissionFileError as error:
            raise MissionFileError(f"{self.source}: {error}") from None
        return mission


def shipped_missions() -> list[str]:
    """The names of the missions that are shipped."""
    folder = resources.files("missions") / "shipped"
    return sorted(f.name.removesuffix(".toml") for f in folder.iterdir())


def load_source(name: str, detector: str | None = None) -> MissionSource:
    """A mission by its path, or by the name of a shipped one. Raises `MissionFileError`.

    A GeoJSON file that `search.prior` names, beside the mission file, and the ground of the GeoTIFF
    that `terrain.dem` names are written into the text, and so is the checksum of the model that
    `detector.model` names. A `detector` (a folder of `uavmap tune`) takes the place of the
    mission's own; what it is made of is read once, to say what is wrong with it before anything
    begins.
    """
    found = _found(name, detector)
    section = found.parse().detector
    try:
        if section.model is not None:
            detector_of_section(section)
    except MissionFileError as error:
        raise MissionFileError(f"{name}: {error}") from None
    return found


def _found(name: str, detector: str | None) -> MissionSource:
    path = Path(name)
    if not path.suffix and name in shipped_missions() and not path.exists():
        text = (resources.files("missions") / "shipped" / f"{name}.toml").read_text("utf-8")
        return MissionSource(name, _judged_by(text, name, Path(), detector))
    try:
        text = read_text(path, LARGEST_BYTES)
    except OSError as error:
        raise MissionFileError(
            f"{name}: cannot be read ({error.strerror}); {_guess(path)}give the path of a mission "
            f"file, or one of the shipped missions: {', '.join(shipped_missions())}"
        ) from None
    except UnicodeDecodeError:
        raise MissionFileError(f"{name}: not a text file in UTF-8") from None
    text = with_prior(text, name, path.parent)
    text = with_terrain(text, name, path.parent)
    return MissionSource(name, _judged_by(text, name, path.parent, detector))


def _guess(path: Path) -> str:
    """What was perhaps meant: a mission file of the same folder, or a shipped mission."""
    known = {} if path.parent != Path() else {name: name for name in shipped_missions()}
    with contextlib.suppress(OSError):
        files = itertools.islice(path.parent.glob("*.toml"), _MOST_LOOKED_AT)
        known |= {file.name: str(file) for file in files}
    near = difflib.get_close_matches(path.name, known, n=1)
    return f"did you mean {known[near[0]]!r}? " if near else ""


def _judged_by(text: str, name: str, folder: Path, detector: str | None) -> str:
    """The text with its detector's files, or those of another."""
    if detector is not None:
        text = with_detector(text, name, Path(detector))
    return with_model(text, name, folder)
