"""Figures of a hand-made flight, against numbers that were added up by hand."""

from dataclasses import replace

import pytest

from missions import events as ev
from missions.flight.setting_of import setting_of
from missions.flight.strategy import sweep_paths as passes
from missions.mapping.belief import FrameId
from missions.mapping.tree import Tree
from missions.units import Cell, GridPoint
from tests.fake_fleet import fleet
from tests.support.small_missions import mission, random_scenario, square
from uavmap.output.facts.figures import figures, finding, summary

HOME = GridPoint(0.0, 0.0)


def setting(vehicles=1):
    return setting_of(
        mission(square(-4, 10, 24, 16), square(-40, -40, 100, 110), vehicles=vehicles)
    )


def connected(vehicle, t_s, *, airborne=False, north_m=0.0):
    place = GridPoint(0.0, north_m)
    return ev.Connected(vehicle, t_s, HOME, place, 12.0 * airborne, airborne, True, 25.0)


def track(vehicle, t_s, east_m, north_m, up_m):
    return ev.Tracked(vehicle, t_s, GridPoint(east_m, north_m), up_m, 20.0)


def figures_of(events, vehicles=1):
    return figures(setting(vehicles), events)[1]


SORTIE = [
    connected(1, 0.0),
    track(1, 1.0, 0, 0, 0.0),
    track(1, 10.0, 0, 0, 0.0),  # lifts off after this
    track(1, 12.0, 0, 0, 5.0),
    ev.Airborne(1, 14.0),
    track(1, 15.0, 3, 4, 12.0),  # 5 m
    track(1, 20.0, 3, 16, 12.0),  # 12 m
    track(1, 30.0, 0, 20, 12.0),  # 5 m
    track(1, 40.0, 0, 0, 6.0),  # 20 m
    ev.Landed(1, 50.0, 10.0),
]


SWAP = [
    ev.BatterySwapped(1, 110.0, 25.0),
    track(1, 120.0, 0, 0, 0.0),
    track(1, 122.0, 0, 0, 4.0),
    track(1, 130.0, 0, 10, 12.0),  # 10 m
    ev.Landed(1, 150.0, 20.0),
]
SECOND = [
    connected(2, 0.5),
    track(2, 30.0, 6, 0, 0.0),
    track(2, 32.0, 6, 0, 6.0),
    track(2, 60.0, 6, 30, 18.0),  # 30 m
    ev.Landed(2, 80.0, 10.0),
]
TAKEN_UP = [  # killed in flight, resumed in the air at another place
    ev.Resumed(100.0),
    connected(1, 101.0, airborne=True, north_m=60.0),
    track(1, 102.0, 0, 60, 12.0),
    track(1, 110.0, 0, 50, 12.0),  # 10 m
    ev.Landed(1, 120.0, 10.0),
]
NIGHT = [ev.Resumed(80_000.0), connected(1, 80_001.0)]  # a failsafe landed the vehicle meanwhile


@pytest.mark.parametrize(
    ("events", "distance_m", "flight_s", "makespan_s", "sorties", "swaps"),
    [
        (SORTIE, 42.0, 40.0, 40.0, 1, 0),
        ([*SORTIE, *SWAP], 52.0, 70.0, 140.0, 2, 1),
        (sorted([*SORTIE, *SECOND], key=lambda e: e.t_s), 72.0, 90.0, 70.0, 2, 0),
        ([*SORTIE[:-1], *TAKEN_UP], 52.0, 110.0, 110.0, 1, 0),
        ([*SORTIE[:-1], *NIGHT], 42.0, 30.0, 30.0, 1, 0),  # until its last report
    ],
    ids=["one sortie", "a swap", "two vehicles", "a way that nobody saw", "a night on the ground"],
)
def test_flight_has_its_figures(events, distance_m, flight_s, makespan_s, sorties, swaps):
    found = figures_of(
        events, vehicles=max(event.vehicle for event in events if event.kind == "tracked")
    )
    assert (found.distance_m, found.flight_time_s) == (distance_m, flight_s)
    assert found.makespan_s == makespan_s
    assert (found.sorties, found.battery_swaps) == (sorties, swaps)
    assert (found.bound_makespan_s, found.bound_held) == (None, None)
    assert (found.lower_bound_s, found.ratio) == (0.0, None)
    assert len(figures_of(SORTIE).tracks[1]) == 5


def test_search_that_finds_the_region_has_a_bound():
    cell = Cell(0, 4)
    votes = tuple(ev.Vote(c, c == cell, 0.9 * (c == cell)) for c in cell.cross())
    events = list(SORTIE[:6])
    events += [ev.FrameSeen(1, 16.0 + n, cell, votes) for n in range(3)]
    state, found = figures(setting(), [*events, *SORTIE[6:]])
    assert state.belief.roi in (frozenset(), frozenset({cell}))
    values = summary(state, found, 7)
    assert values["seed"] == 7
    assert values["distance_m"] == found.distance_m
    assert values["iou_cells"] is None
    assert values["cells_roi"] == len(state.belief.roi)


@pytest.mark.parametrize(
    ("others", "what", "rest"),
    [
        ((), "a region of 2 cells", ""),
        (((3, 1),), "a patch of the region, 2 cells,",
         "; 1 more cell lies in another patch, which is not explored"),
        (((3, 2), (5, 3)), "a patch of the region, 2 cells,",
         "; 5 more cells lie in 2 other patches, which are not explored"),
    ],
)  # fmt: skip
def test_finding_other_patches_seen_counts_only_the_explored_one(others, what, rest):
    """The tree knows one patch: two cells. The other patches are columns of cells in the east."""
    made, explored = setting(), [Cell(0, 4), Cell(0, 5)]
    state = made.initial_state()
    roi = [*explored, *(Cell(east, 4 + k) for east, high in others for k in range(high))]
    belief = state.belief
    for t_s in (1.0, 2.0, 3.0):
        belief = belief.with_frame(None, FrameId(1, t_s), dict.fromkeys(roi, True))
    tree = (
        Tree.rooted(explored[0])
        .with_observation(explored[0], explored[1:])
        .with_observation(explored[1], ())
    )
    state = replace(state, belief=belief, tree=tree)
    assert finding(state) == f"{what} in 3 judged frames, explored to its end{rest}"


def test_flight_without_events_has_figures_of_zero():
    state, found = figures(setting(3), [])
    assert (found.distance_m, found.flight_time_s, found.makespan_s) == (0.0, 0.0, 0.0)
    assert (found.sorties, found.battery_swaps, found.exploration_s) == (0, 0, 0.0)
    assert summary(state, found, None)["completed"] is False


# --- the certificate -------------------------------------------------------------------------
def summary_and_figures(seed, strategy):
    scenario = random_scenario(seed, drift=bool(seed % 2))
    flight = fleet(scenario.mission.model_copy(update={"strategy": strategy}), scenario.roi)
    flight.start()
    flight.run()
    state, found = figures(flight.setting, flight.events)
    return summary(state, found, seed), found


@pytest.mark.parametrize("seed", [1, 2, 9])
def test_exploration_lies_between_its_bounds(seed):
    values, found = summary_and_figures(seed, "rdfs")
    assert found.bound_makespan_s is not None
    assert 0.0 < found.lower_bound_s <= found.exploration_s <= found.bound_makespan_s
    assert found.ratio == pytest.approx(found.exploration_s / found.lower_bound_s, abs=1e-3)
    assert values["lower_bound_s"] == found.lower_bound_s
    assert values["ratio"] == found.ratio
    assert values["bound_held"] is True


@pytest.mark.parametrize(("strategy", "seed"), [("rdfs-paper", 2), ("greedy", 5), ("bfdn", 2)])
def test_bound_that_does_not_hold_in_flight_is_left_out(strategy, seed):
    """`rdfs-paper` has no bound; `greedy` alone flies straight; no team flies in rounds."""
    values, found = summary_and_figures(seed, strategy)
    assert found.lower_bound_s > 0.0
    assert (values["bound_makespan_s"], values["bound_held"]) == (None, None)


def test_single_vehicle_keeps_the_bound_of_bfdn():
    assert summary_and_figures(5, "bfdn")[0]["bound_held"] is True


def test_flight_that_falls_back_on_stopping_has_a_lower_bound(monkeypatch):
    monkeypatch.setattr(passes, "patience_s", lambda state: 0.5)
    made = mission(
        square(-4, 10, 24, 16),
        square(-40, -40, 120, 130),
        strategy="swath",
        capacity_wh=200.0,
        mounting="gimbal",
    )
    flight = fleet(made, frozenset(Cell(i, j) for i in range(10) for j in range(3, 13)))
    flight.start()
    flight.run()
    state, found = figures(flight.setting, flight.events)
    assert state.falls_back
    assert state.completed
    # 100 cells and their neighbours at 5 m/s, less the area that the first frame may have shown
    assert 5.0 < found.lower_bound_s < found.exploration_s
    assert found.ratio is not None
    (patch,) = summary(state, found, None)["patches"]
    assert patch["complete"]
    assert 1.0 < patch["lower_bound_s"] < patch["took_s"]
