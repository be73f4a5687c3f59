"""Whole flights over a slope of 10 %, over MAVLink bytes in this process, by both autopilots."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import pytest
from shapely.geometry import Polygon, box

from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.geo.grid import Grid
from missions.geo.terrain import FOLLOW_M
from missions.units import Cell, GridPoint, LatLon, Pose
from sitl.camera.pinhole import CameraSpec, Shot
from sitl.camera.render import render
from sitl.vehicle import SimVehicle
from sitl.world.world import Patch, World, WorldSpec
from tests.benchmarks.frame import truth_shown
from tests.e2e.rig import ROI_STATES
from tests.support.ground.hills import checked, over, slope, text_over
from tests.support.small_missions import START, mission_text, square, with_small_pictures
from uavmap.base.image_files import decoded
from uavmap.runner.simulation import relief_of
from uavmap.ui.cli import main
from vision.camera import Camera
from vision.detectors import make_detector
from vision.projection import Frame, judge_frame

ALTITUDE_M = 14.0
TOWARD_DEG = 225.0
"""Bearing towards which the ground falls from the start over the box, degrees."""


class TerrainFlight:
    def __init__(self, folder: Path, autopilot: str, strategy: str) -> None:
        text = mission_text(
            square(32, 35, 16, 9), square(-20, -20, 95, 95), altitude_m=ALTITUDE_M,
            strategy=strategy, regions=[square(34, 37, 13, 9)],
        )  # fmt: skip
        text = with_small_pictures(text)
        grid = setting_of(checked(text)).grid
        text = text_over(text, slope(10.0, TOWARD_DEG))
        text += f'\n[sim]\nautopilot = "{autopilot}"\ngps_sigma_m = 0.05\n'
        (folder / "m.toml").write_text(text, "utf-8")
        self.heights_m: list[float] = []
        self.crashed = False

        def record(vehicles: Sequence[SimVehicle], setting: Setting) -> None:
            for vehicle in vehicles:
                real = vehicle.truth
                away_m = setting.grid.fixed(real.position).distance_to(GridPoint(0.0, 0.0))
                if not real.landed and away_m > 3.0:
                    self.heights_m.append(real.height_m)
                self.crashed |= real.crashed

        arguments = ["fly", str(folder / "m.toml"), "--sim", "--seed", "1", "--json"]
        with truth_shown(record):
            self.code = main([*arguments, "--out", str(folder / "out")])
        self.map = json.loads((folder / "out" / "map.geojson").read_text("utf-8"))
        self.mission = checked((folder / "m.toml").read_text("utf-8"))
        roi = self.mission.sim.roi[0].polygon
        self.roi = Polygon([grid.fixed(LatLon(*vertex)) for vertex in roi])

    def wrong_by_m(self) -> float:
        """Return the error of the worst cell, m: the true region, shrunk or widened by so much,
        agrees.

        In steps of a quarter of a metre.
        """
        return max(self._wrong_by_m(feature["properties"]) for feature in self.map["features"])

    def _wrong_by_m(self, cell: dict[str, object]) -> float:
        if cell["kind"] != "cell":
            return 0.0
        column, row = int(str(cell["column"])), int(str(cell["row"]))
        square_m = box(4 * column - 2, 4 * row - 2, 4 * column + 2, 4 * row + 2)
        told = cell["state"] in ROI_STATES
        for quarters in range(40):
            shifted = self.roi.buffer(quarters / 4.0 * (1 if told else -1), join_style="mitre")
            share = square_m.intersection(shifted).area / 16.0
            if (share >= self.mission.detector.share) == told:
                return quarters / 4.0
        return 10.0


@pytest.mark.parametrize(("autopilot", "strategy"), [("ardupilot", "rdfs"), ("px4", "swath")])
def test_flight_over_a_slope_has_right_cells_and_stays_clear_of_the_ground(
    autopilot, strategy, tmp_path
):
    flown = TerrainFlight(tmp_path, autopilot, strategy)
    assert flown.code == 0
    assert not flown.crashed
    assert min(flown.heights_m) >= ALTITUDE_M - FOLLOW_M
    assert max(flown.heights_m) <= ALTITUDE_M + 1.5 * FOLLOW_M
    assert flown.wrong_by_m() <= 0.5 * 4.0


@pytest.mark.parametrize("pitch_deg", [0.0, 8.0])
def test_picture_over_a_slope_judges_each_cell_right(pitch_deg):
    """The simulator renders by rays and the service reads by corners: the ground is the same.

    On flat ground the cells would be off by metres.
    """
    heights, grid = slope(20.0, TOWARD_DEG), Grid.at(START, 4.0)
    bare = mission_text(square(4, 10, 24, 16), square(-40, -40, 110, 110), altitude_m=ALTITUDE_M)
    mission = over(checked(bare), heights)
    assert mission.ground is not None
    relief = relief_of(mission, grid)
    area = Polygon([(14, 12), (34, 18), (28, 40), (10, 30)])
    patch = Patch(tuple(grid.position(GridPoint(*xy)) for xy in area.exterior.coords[:-1]))
    plain = {"texture": 0.0, "sensor_noise": 0.0, "illumination": 0.0}
    world = World(WorldSpec(START, 500.0, (patch,), relief=relief, **plain))
    spec = CameraSpec(hfov_deg=80.0, width_px=640, height_px=480)
    place = grid.position(GridPoint(20.0, 22.0))
    east_m, north_m = world.plane.to_plane(place)
    attitude = spec.attitude(0.05, math.radians(pitch_deg), 0.7)
    # flown level at 14 m above home, where the ground lies 6 m lower
    ground_m = world.ground_m(east_m, north_m)
    above_m = ALTITUDE_M - ground_m
    shot = Shot(east_m, north_m, above_m - 0.1, attitude, 0.0, 1, ground_m=ground_m)
    picture = decoded(render(world, spec, shot), "frame.jpg", (640, 480))
    worst: dict[str, float] = {}
    for name, height_m, terrain in (
        ("ground", above_m, mission.ground), ("home", ALTITUDE_M, None),
    ):  # fmt: skip
        frame = Frame(picture, Pose(place, height_m, attitude), 0.0, CAMERA)
        verdicts = judge_frame(
            frame, grid, _DETECTOR, share=0.3, view="all", margin_m=0.5, terrain=terrain
        )
        assert len(verdicts) >= 6
        off = [
            abs(v.share - box(*_square(v.cell)).intersection(area).area / 16.0) for v in verdicts
        ]
        worst[name] = max(off)
    assert worst["ground"] < 0.12
    assert worst["home"] > 0.4


CAMERA = Camera(math.radians(80.0), 640, 480)
_DETECTOR = make_detector("threshold", intensity=100, dilations=0, polarity="dark")


def _square(cell: Cell) -> tuple[float, float, float, float]:
    return 4.0 * cell.east - 2, 4.0 * cell.north - 2, 4.0 * cell.east + 2, 4.0 * cell.north + 2
