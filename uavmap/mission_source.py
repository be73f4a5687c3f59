"""Mission files on the disk, and those that are shipped."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Final

from missions.errors import MissionFileError
from missions.mission_file.checks import STRATEGIES, parse_mission
from missions.mission_file.schema import Mission
from uavmap.dem import with_terrain
from uavmap.prior_file import with_prior
from uavmap.text_files import read_text
from vision.detectors import detector_names

LARGEST_BYTES: Final = 4_000_000


@dataclass(frozen=True, slots=True)
class MissionSource:
    """The text of a mission and where it came from."""

    source: str
    text: str

    def parse(self) -> Mission:
        """The checked mission. Raises `MissionFileError`."""
        return parse_mission(
            self.text, self.source, strategies=STRATEGIES, detectors=tuple(detector_names())
        )


def shipped_missions() -> list[str]:
    """The names of the missions that are shipped."""
    folder = resources.files("missions") / "shipped"
    return sorted(f.name.removesuffix(".toml") for f in folder.iterdir())


def load_source(name: str) -> MissionSource:
    """A mission by its path, or by the name of a shipped one. Raises `MissionFileError`.

    A GeoJSON file that `search.prior` names, beside the mission file, and the ground of the GeoTIFF
    that `terrain.dem` names are written into the text.
    """
    path = Path(name)
    if not path.suffix and name in shipped_missions() and not path.exists():
        text = (resources.files("missions") / "shipped" / f"{name}.toml").read_text("utf-8")
        return MissionSource(name, text)
    try:
        text = read_text(path, LARGEST_BYTES)
    except OSError as error:
        raise MissionFileError(
            f"{name}: cannot be read ({error.strerror}); give the path of a mission file, or one "
            f"of the shipped missions: {', '.join(shipped_missions())}"
        ) from None
    except UnicodeDecodeError:
        raise MissionFileError(f"{name}: not a text file in UTF-8") from None
    text = with_prior(text, name, path.parent)
    return MissionSource(name, with_terrain(text, name, path.parent))
