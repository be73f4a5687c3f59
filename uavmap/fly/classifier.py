"""How a mission looks at pictures: frame -> look(frame, grid, detector) -> votes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from missions.events import Vote
from missions.ground.grid import Grid
from missions.mission_file.schema import Mission
from missions.units import Cell
from vision.camera import Camera
from vision.detectors import Detector, make_detector
from vision.look import Frame, look


@dataclass(frozen=True, slots=True)
class Classifier:
    """How a mission looks at pictures: camera, detector, and the share that makes a cell ROI."""

    mission: Mission
    grid: Grid
    camera: Camera
    detector: Detector

    @classmethod
    def of(cls, mission: Mission, grid: Grid, height_m: float | None = None) -> Classifier:
        """The classifier that a mission file describes, for a vehicle that flies at a height."""
        camera = Camera(
            math.radians(mission.camera.hfov_deg),
            mission.camera.width_px,
            mission.camera.height_px,
        )
        lowest_m = mission.altitude_m(0)
        return cls(mission, grid, camera, detector_of(mission, (height_m or lowest_m) / lowest_m))

    def votes(self, frame: Frame, vantage: Cell | None) -> tuple[Cell, tuple[Vote, ...]]:
        """The vantage of a frame, and what it says.

        Without a vantage given, it is the cell below; frames that judge all that they show count
        as one look over the whole area, and that goes by the name of the grid's first cell.
        """
        section = self.mission.detector
        below = self.grid.cell_at(frame.pose.position, frame.t_s)
        here = vantage or (below if section.view == "cross" else Cell(0, 0))
        verdicts = look(
            frame, self.grid, self.detector, share=section.share, view=section.view, vantage=here
        )
        return here, tuple(Vote(v.cell, v.positive, round(v.share, 3)) for v in verdicts)


def detector_of(mission: Mission, height_ratio: float = 1.0) -> Detector:
    """The detector that a mission file names, with its parameters.

    Dilations are counted in pixels at the lowest layer. From `height_ratio` times that height a
    pixel shows so much more ground, and fewer dilations bridge the same gap.
    """
    section = mission.detector
    dilations = round(section.dilations / height_ratio)
    if section.name == "threshold":
        return make_detector(
            "threshold",
            intensity=section.intensity,
            dilations=dilations,
            polarity=section.polarity,
        )
    return make_detector(
        section.name,
        greenness=section.greenness,
        intensity=section.intensity,
        dilations=dilations,
    )
