"""The missions that come with the package can be flown, and agree with their comments."""

from __future__ import annotations

from importlib import resources
from itertools import combinations, pairwise

import pytest
from shapely.geometry import MultiPolygon, Polygon

from missions.errors import MissionFileError
from missions.geo.grid import Grid
from missions.mission.checks import check
from missions.mission.fleet_checks import check_fleet, with_own_air
from missions.mission.places import homes
from missions.mission.schema import Mission, positions
from uavmap.load.mission_source import load

NAMES = ["bay", "burn", "runway", "runway-field", "slick", "spill", "road"]
NONSTOP = {"bay", "burn", "runway", "slick", "spill"}


def regions(mission: Mission) -> list[Polygon]:
    grid = Grid.at(mission.home, mission.grid.cell_m)
    return [
        Polygon(
            [grid.fixed(place) for place in positions(region.polygon)],
            [[grid.fixed(place) for place in positions(hole)] for hole in region.holes],
        )
        for region in mission.sim.roi
    ]


@pytest.mark.parametrize("name", NAMES)
def test_shipped_mission_passes_its_checks_and_stops_where_it_repeats_a_paper(name):
    assert load(name).name == name
    assert load(name).strategy == ("swath" if name in NONSTOP else "rdfs")


def test_shipped_missions_are_these_alone():
    files = (resources.files("missions") / "shipped").iterdir()
    assert sorted(f.name for f in files if f.name.endswith(".toml")) == sorted(
        f"{name}.toml" for name in NAMES
    )


@pytest.mark.parametrize("name", ["runway", "runway-field"])
def test_the_runway_is_92_by_21_metres_and_turned(name):
    mission = load(name)
    (runway,) = regions(mission)
    corners = list(runway.exterior.coords)
    edges = sorted(
        ((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5 for (x0, y0), (x1, y1) in pairwise(corners)
    )
    assert edges == pytest.approx([21, 21, 92, 92], abs=0.05)
    assert runway.area / runway.envelope.area < 0.5  # far from aligned with the grid
    assert mission.battery.endurance_s == 720.0
    assert len(mission.vehicles) == 1


def test_the_two_runways_differ_in_settings_only():
    best, field = (load(name).model_dump(warnings=False) for name in ("runway", "runway-field"))
    assert {key for key in best if best[key] != field[key]} == {
        "name",
        "strategy",
        "search",
        "flight",
        "camera",
        "detector",
    }
    del best["detector"]["share"], field["detector"]["share"]  # of frames in motion, and at rest
    assert best["detector"] == field["detector"]
    assert best["search"]["box"] == field["search"]["box"]
    assert field["flight"]["speed_m_s"] == 1.0
    assert field["camera"]["interval_s"] == 1.0


def test_the_burn_is_compact_and_a_sixth_of_its_box():
    mission = load("burn")
    (burn,) = regions(mission)
    grid = Grid.at(mission.home, mission.grid.cell_m)
    box = Polygon([grid.fixed(place) for place in positions(mission.search.box)])
    cell_m = mission.grid.cell_m
    assert 380 <= burn.area / cell_m**2 <= 410
    assert box.contains(burn)
    assert box.area / cell_m**2 == pytest.approx(2500, abs=5)
    assert burn.area / burn.convex_hull.area > 0.9


def test_the_spill_is_fat_and_has_a_hole_that_cells_can_show():
    mission = load("spill")
    (spill,) = regions(mission)
    cell_m = mission.grid.cell_m
    assert 150 <= spill.area / cell_m**2 <= 200
    core = spill.buffer(-1.5 * cell_m)  # three cells wide everywhere: shrinking keeps it whole
    assert core.geom_type == "Polygon"
    assert len(core.interiors) == 1
    (hole,) = spill.interiors
    assert not Polygon(hole).buffer(-1.5 * cell_m).is_empty
    assert len(mission.vehicles) == 3


def test_the_spill_stays_in_the_fence_for_twenty_minutes():
    mission = load("spill")
    grid = Grid.at(
        mission.home, mission.grid.cell_m, mission.drift.speed_m_s, mission.drift.toward_deg
    )
    fence = Polygon([grid.fixed(place) for place in positions(mission.fence.polygon)])
    (spill,) = regions(mission)
    for t_s in (0.0, 1200.0):
        moved = [
            (x + grid.drift_east_m_s * t_s, y + grid.drift_north_m_s * t_s)
            for x, y in spill.exterior.coords
        ]
        assert fence.buffer(-25).contains(Polygon(moved))


def test_the_film_in_the_bay_is_wide_and_in_three_pieces():
    mission = load("bay")
    grid = Grid.at(mission.home, mission.grid.cell_m)
    pieces = regions(mission)
    box = Polygon([grid.fixed(place) for place in positions(mission.search.box)])
    assert len(pieces) == 3
    assert sum(len(piece.interiors) for piece in pieces) == 1
    assert all(box.contains(piece) and piece.length**2 / piece.area > 14.0 for piece in pieces)
    assert not any(a.intersects(b) for a, b in pairwise(pieces))
    assert 0.25e6 <= sum(piece.area for piece in pieces) <= 0.35e6
    west, _, east, _ = MultiPolygon(pieces).bounds
    assert 900.0 <= east - west <= 1000.0
    assert box.area == pytest.approx(1.4e6, rel=1e-4)
    pads = [grid.fixed(place) for place in homes(mission)]
    assert min(a.distance_to(b) for a, b in combinations(pads, 2)) >= 20.0
    heights = [(mission.altitude_m(k), mission.search_altitude_m(k)) for k in range(len(pads))]
    assert heights == [(39.0, 100.0)] * 2 + [(42.0, 100.0)] * 3


def test_vehicles_of_a_fleet_share_no_layer():
    mission = with_own_air(load("bay"))
    check_fleet(mission, "bay.toml")
    check(mission, "bay.toml")
    heights = [(mission.altitude_m(k), mission.search_altitude_m(k)) for k in range(5)]
    assert heights == [(30.0 + 3.0 * k, 88.0 + 3.0 * k) for k in range(5)]
    assert with_own_air(mission) == mission
    many = load("bay").model_copy(update={"vehicles": load("bay").vehicles[:1] * 15})
    with pytest.raises(MissionFileError, match=r"the lowest is at -3 m.*fly fewer vehicles"):
        check_fleet(with_own_air(many), "bay.toml")
