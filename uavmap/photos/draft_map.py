"""A map in a few seconds: cells by a new detector over the mosaic, and the pictures to paint next.

Only a picture of it is kept: `uavmap replay` makes the map for further use.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.mapping.frame_sums import FrameSums
from uavmap.base.messages import muted
from uavmap.load.detector_source import detector_text
from uavmap.load.mission_source import mission_of_text
from uavmap.output.drawing.map_scene import map_scene, map_view
from uavmap.output.drawing.sheet import write_sheet
from uavmap.output.results import map_of
from uavmap.photos.ground.fine_map import beneath
from uavmap.photos.ground.surface import Scene
from uavmap.photos.mission_from_photos import derived
from uavmap.photos.next_pictures import Next, pictures_to_paint
from uavmap.photos.picture_replay import JudgedPictures, judge_pictures
from uavmap.photos.registration.refined_pictures import refined
from uavmap.photos.scratch_file import Spool
from uavmap.photos.sources.inventory import Gathered, gather, open_source
from uavmap.photos.sources.picture_record import Placed, credible

MAP: Final = "map.png"


class Drafts:
    """Drafts of the map of a folder of pictures, whose positions are found once.

    Attributes:
        asked: Pictures to paint next, of the last draft.
    """

    def __init__(self, images: Path) -> None:
        self._images = images
        self._gathered: Gathered | None = None
        self.asked: Sequence[Next] = ()

    def draw(self, detector: Path, folder: Path) -> None:
        """Draw `map.png` in a folder.

        Raises `ImageError` if no picture can be placed, `MissionFileError` if no mission covers
        them.
        """
        self.asked = ()
        with muted():
            gathered = self._gathered or _placed(self._images)
            self._gathered = gathered
            text = derived(gathered, None, detector=detector_text(detector))
            setting = setting_of(mission_of_text(text, str(self._images)))
            with Spool() as spool:
                looked = judge_pictures(gathered, setting, spool)
                looked.refuse_empty()
                self.asked = _drawn(looked, setting, folder / MAP)


def _placed(images: Path) -> Gathered:
    """Return the pictures; overlaps register them if tags place less than half of them."""
    gathered = gather(open_source(images))
    verdicts = credible(gathered.posed)
    if 2 * sum(isinstance(verdict, Placed) for verdict in verdicts) >= len(verdicts):
        return gathered
    return refined(gathered).gathered


def _drawn(looked: JudgedPictures, setting: Setting, path: Path) -> list[Next]:
    sums = FrameSums()
    table, _ = looked.counted(sums)
    end_s = looked.shots[looked.numbers[-1]].t_s
    data = replace(map_of(setting, end_s, table, ()), pictures=len(looked.numbers))
    scene = Scene.from_footings(looked.footings(), setting)
    ground = None
    if scene is not None:
        ground = beneath(scene, looked.spool, setting.grid, looked.threads, end_s)(map_view(data))
    write_sheet(map_scene(data), path, ground)
    return pictures_to_paint(looked.judged(), sums, setting.grid.cell_m**2)
