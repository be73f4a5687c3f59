"""Single situations of `step`: the changes by one event, and the orders after it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from shapely.geometry import LineString, Point

from missions.events import (
    Airborne,
    Arrived,
    BatterySwapped,
    Connected,
    Crashed,
    Event,
    FrameLost,
    FrameSeen,
    Landed,
    LiftedOff,
    LinkLost,
    LookEnded,
    OrderFailed,
    Overridden,
    Recalled,
    Released,
    Resumed,
    Tracked,
    Vote,
)
from missions.flight.setting_of import setting_of
from missions.flight.step import Orders, step
from missions.flight.strategy.stepwise import Stepwise
from missions.flight.transitions import MAX_RETURN_ATTEMPTS_AROUND_HOLE, apply
from missions.flight.vehicle_state import Phase, ReturnReason
from missions.geo.trajectory import Trajectory
from missions.mapping.tree import Tree
from missions.mission.schema import Mission
from missions.orders import (
    AwaitBattery,
    FlyTo,
    Hold,
    Land,
    Look,
    Order,
    ReturnToLaunch,
    StandDown,
    Sweep,
    TakeOff,
)
from missions.planning.stepwise import EXPLORERS
from missions.units import Cell, GridPoint
from tests.fake_fleet import fleet
from tests.support.small_missions import Points, mission, square
from uavmap.output.facts.figures import aircraft_down

HOME = GridPoint(0.0, 0.0)
ROOT = Cell(2, 6)


class Service:
    """The service in a test: events in, orders out, and the state between."""

    def __init__(self, made: Mission) -> None:
        self.setting = setting_of(made)
        self.state = self.setting.initial_state()
        self.now_s = 0.0

    def post(self, *events: Event) -> Orders:
        orders: Orders = ()
        for event in events:
            self.now_s = max(self.now_s, event.t_s)
            self.state, orders = step(self.state, event)
        return orders

    def connect(self, vehicle: int = 1, *, at: GridPoint = HOME, height_m: float = 0.0) -> Orders:
        wh = self.setting.mission.battery.capacity_wh
        t_s = self.now_s
        return self.post(Connected(vehicle, t_s, at, at, height_m, height_m > 0.0, True, wh))

    def connect_all(self) -> None:
        """Connect all vehicles on their pads, 8 m apart."""
        for vehicle in self.state.vehicles:
            self.connect(vehicle, at=GridPoint(8.0 * (vehicle - 1), 0.0))

    def track(self, vehicle: int, at: GridPoint, height_m: float = 12.0) -> Orders:
        self.now_s += 1.0
        wh = self.state.vehicles[vehicle].remaining_wh - 0.1
        return self.post(Tracked(vehicle, self.now_s, at, height_m, wh))

    def take_off(self, vehicle: int = 1) -> Orders:
        self.connect(vehicle)
        return self.post(Airborne(vehicle, 8.0))

    def put(self, vehicle: int, **how: Any) -> None:
        """Change the state of a vehicle."""
        there = replace(self.state.vehicles[vehicle], **how)
        self.state = self.state.with_vehicle(there)

    def fly(self, vehicle: int, at: GridPoint, **how: Any) -> None:
        """Put a vehicle somewhere into the air of its layer, without an order."""
        layer_m = self.state.vehicles[vehicle].cruise_height_m
        there = {"order": None, "height_m": layer_m, "position": at, **how}
        self.put(vehicle, phase=Phase.AIRBORNE, landed=False, **there)

    def order(self, vehicle: int = 1) -> Order | None:
        return self.state.vehicles[vehicle].order

    def leg(self, vehicle: int = 1) -> FlyTo:
        """Return the leg that a vehicle flies; fail on any other order."""
        order = self.order(vehicle)
        assert isinstance(order, FlyTo)
        return order

    def recall(self, vehicle: int, at: GridPoint) -> None:
        """Recall all vehicles; one comes to rest at a place first."""
        self.state = replace(self.state, recalled=True)
        for _ in range(12):
            self.now_s += 1.0
            self.track(vehicle, at)

    def path(self, vehicle: int = 1) -> Trajectory:
        """Return the path that a vehicle flies without stops."""
        path = self.state.vehicles[vehicle].path
        assert path is not None
        return path

    def exploring(self, vehicle: int = 1, *, at: Cell = ROOT) -> None:
        """Begin the exploration: the ROI was just found and the vehicle hovers over its root."""
        here, full_wh = self.setting.grid.centre_of(at), self.setting.mission.battery.capacity_wh
        self.state = replace(self.state, tree=Tree.rooted(at), found_s=self.now_s)
        self.fly(
            vehicle, here, vertex=at, at_target=True, height_m=12.0, lanes=(), remaining_wh=full_wh
        )
        self.track(vehicle, here)


def frame(
    vehicle: int, t_s: float, vantage: Cell, *positive: Cell, of: tuple[Cell, ...] | None = None
) -> FrameSeen:
    cells = of if of is not None else vantage.cross()
    votes = tuple(Vote(c, c in positive, float(c in positive)) for c in cells)
    return FrameSeen(vehicle, t_s, vantage, votes)


BOX, FENCE = square(-10, 16, 40, 30), square(-60, -60, 160, 160)


def over(box: Points = BOX, fence: Points = FENCE, **how: Any) -> Service:
    """Return the service of a small mission."""
    return Service(mission(box, fence, **{"capacity_wh": 60.0, **how}))


@pytest.fixture
def service() -> Service:
    return over()


@pytest.fixture
def pair() -> Service:
    return over(vehicles=2)


# --- taking off, searching -------------------------------------------------------------------
def test_a_sortie_begins_with_take_off_flight_and_sweep(service: Service) -> None:
    assert service.connect() == ((1, TakeOff(12.0)),)
    ((_, leg),) = service.post(Airborne(1, 8.0))
    assert isinstance(leg, FlyTo)
    ((_, sweep),) = service.post(Arrived(1, 12.0, leg.route[-1]))
    assert sweep == Sweep(service.setting.lanes[0][1], 4.0, 12.0)


def test_suspicion_is_observed_and_the_find_becomes_the_root(service: Service) -> None:
    service.take_off()
    start = service.setting.lanes[0][0]
    service.post(Arrived(1, 12.0, start))
    suspect = Cell(0, 6)
    service.post(frame(1, 14.0, suspect, suspect))
    assert service.order() == Hold()  # it comes to rest first
    service.track(1, start)
    service.track(1, start)
    order = service.leg()
    assert order.cell == suspect
    t_s = service.now_s
    service.post(Arrived(1, t_s, service.setting.grid.centre_of(suspect)))
    assert service.order() == Look(suspect, 30, 12.0)
    for i in range(5):
        service.post(frame(1, t_s + 1 + i, suspect, suspect, Cell(0, 7)))
    assert service.state.tree is not None
    assert service.state.tree.root == suspect
    assert service.state.tree.children(suspect) == (Cell(0, 7),)
    assert service.state.found_s == t_s + 4  # the search frame over the cell counts


def test_a_frame_from_anywhere_is_evidence_and_nothing_more(service: Service) -> None:
    service.take_off()
    service.post(Arrived(1, 12.0, service.setting.lanes[0][0]))
    order, seen = service.order(), Cell(0, 6)
    votes = (Vote(seen, True, 1.0), Vote(Cell(1, 6), False, 0.0))
    for i in range(3):
        service.post(FrameLost(1, 13.0 + i, "black"), FrameSeen(1, 13.1 + i, None, votes))
    vehicle, belief = service.state.vehicles[1], service.state.belief
    assert service.order() == order
    assert (vehicle.candidate, vehicle.lane_seen_m, vehicle.frames_lost) == (None, (), 0)
    assert service.state.tree is None
    assert belief.roi == {seen}
    assert belief.verdict(Cell(1, 6)) is False
    service.post(FrameSeen(1, 12.9, None, ((Vote(Cell(1, 6), True, 1.0)),)))  # it came late
    assert service.state.belief.verdict(Cell(1, 6)) is False


def test_late_frame_on_the_return_is_a_suspicion_for_the_next_sortie(
    service: Service,
) -> None:
    service.take_off()
    service.post(Arrived(1, 12.0, service.setting.lanes[0][0]))
    low_wh = service.setting.energy.reserve_wh
    service.post(Tracked(1, 13.0, service.setting.lanes[0][0], 12.0, low_wh))
    assert service.state.vehicles[1].return_reason is ReturnReason.BATTERY
    service.post(frame(1, 13.5, Cell(0, 6), Cell(0, 6)))
    assert service.state.vehicles[1].candidate == Cell(0, 6)
    assert service.state.vehicles[1].return_reason is ReturnReason.BATTERY


def test_suspicion_of_a_vehicle_that_dropped_out_is_observed_by_another(pair: Service) -> None:
    pair.connect_all()
    suspect = Cell(0, 6)
    pair.put(1, candidate=suspect, lanes=())
    pair.put(2, lanes=())
    pair.post(OrderFailed(1, 1.0, "take off", "no arming"))
    pair.post(Airborne(2, 12.0))
    pair.track(2, GridPoint(8.0, 0.0), 18.0)
    assert not pair.state.exhausted
    assert pair.state.vehicles[2].candidate == suspect


def test_a_lane_behind_a_wall_is_given_up_not_flown_through_it() -> None:
    """The fence has two halves with a gap: the box lies in both, home in one."""
    wall = square(-60, 10, 160, 4)
    made = mission(square(0, -4, 30, 44), square(-59, -60, 158, 160), [wall], capacity_wh=60.0)
    flight = fleet(made, roi={Cell(2, 7)})
    flight.start()
    flight.run(300.0)
    assert flight.faults == []
    assert flight.state.belief.roi == frozenset()


def test_a_lane_too_long_for_one_battery_is_searched_in_pieces() -> None:
    made = mission(
        square(-140, 20, 280, 8), square(-200, -60, 400, 160), capacity_wh=14.0, speed_m_s=5.0
    )
    flight = fleet(made, roi=())
    flight.start()
    flight.run()
    assert flight.faults == []
    assert flight.state.exhausted
    assert flight.state.completed
    (vehicle,) = flight.state.vehicles.values()
    assert not flight.state.with_vehicle(replace(vehicle, landed=False)).completed
    assert flight.state.belief.roi == frozenset()
    assert sum(isinstance(order, TakeOff) for _, _, order in flight.orders) > 1


def test_vehicle_with_nothing_to_search_waits_over_its_own_pad(pair: Service) -> None:
    """Below the column of another it would keep a vehicle with a low battery from landing."""
    pad = GridPoint(8.0, 0.0)
    pair.connect_all()
    pair.fly(1, pad, lanes=())
    lanes, reason = pair.state.vehicles[2].lanes[-1:], ReturnReason.BATTERY
    pair.fly(2, pad, order=Hold(), over_home=True, return_reason=reason, lanes=lanes)
    pair.track(2, pad, 18.0)
    assert isinstance(pair.order(1), FlyTo)
    pair.post(Arrived(1, pair.now_s + 2.0, HOME))
    assert pair.order(1) == Hold()
    assert pair.order(2) == Land()


# --- exploring -------------------------------------------------------------------------------
def test_a_late_positive_still_grows_the_tree(service: Service) -> None:
    service.exploring()
    for t in range(2):
        service.post(frame(1, 20.0 + t, ROOT, ROOT))
    service.post(LookEnded(1, 22.0))
    assert service.state.tree is not None
    assert service.state.tree.is_explored(ROOT)
    north = Cell(ROOT.east, ROOT.north + 1)
    for t in range(3):
        service.post(frame(1, 22.5 + t, ROOT, ROOT, north))
    assert service.state.tree.children(ROOT) == (north,)
    assert not service.state.exploration_finished


def test_confirmed_cell_is_not_taken_back_by_a_frame_that_comes_late(service: Service) -> None:
    service.exploring()
    north = Cell(ROOT.east, ROOT.north + 1)
    for t in range(5):
        service.post(frame(1, 20.0 + t, ROOT, *((ROOT, north) if t >= 2 else (ROOT,))))
    assert north in service.state.belief.roi
    for t in range(5):
        service.post(frame(1, 10.0 + t, ROOT, ROOT))  # taken before, by a picture that was slow
    assert north in service.state.belief.roi
    assert service.state.tree is not None
    assert service.state.tree.children(ROOT) == (north,)


def test_a_look_that_ends_early_leaves_the_cell_undecided(service: Service) -> None:
    service.exploring()
    service.post(frame(1, 20.0, ROOT, ROOT, of=(ROOT,)), LookEnded(1, 21.0))
    assert service.state.undecided == {ROOT}
    assert service.state.exploration_finished
    assert not service.state.completed


def test_a_silent_camera_brings_the_vehicle_home_for_good(service: Service) -> None:
    service.exploring()
    service.post(LookEnded(1, 21.0))
    vehicle = service.state.vehicles[1]
    assert vehicle.return_reason is ReturnReason.FAULT
    assert isinstance(vehicle.order, FlyTo)
    service.post(Arrived(1, 25.0, HOME))
    assert service.order() == Land()
    service.post(Landed(1, 40.0, 50.0))
    assert service.state.vehicles[1].phase is Phase.FAILED


def test_a_vertex_that_drifted_out_of_the_fence_does_not_stop_the_exploration() -> None:
    """It was observed, and its child is still inside. (This once recursed for ever.)"""
    service = over(square(-10, 16, 40, 20), drift_m_s=0.4, toward_deg=0.0)
    root, far, near = Cell(0, 20), Cell(0, 21), Cell(0, 19)
    service.exploring(at=root)
    tree = Tree.rooted(root).with_observation(root, [far, near]).with_observation(far, [])
    vehicle = replace(service.state.vehicles[1], vertex=root, at_target=False, order=None)
    late = replace(service.state, tree=tree, t_s=50.0).with_vehicle(vehicle)
    assert not service.setting.fence.allows(
        service.setting.grid.to_fixed(service.setting.grid.centre_of(root), 70.0)
    )
    service.state, service.now_s = late, 70.0
    for _ in range(6):
        service.track(1, GridPoint(0.0, 90.0))
    assert service.state.tree is not None
    assert root not in service.state.abandoned
    assert service.state.exploration_finished or service.state.vehicles[1].vertex == near


def test_cell_that_drifts_out_of_the_fence_before_is_not_flown_to() -> None:
    service = over(square(-10, 16, 40, 20), drift_m_s=0.4, toward_deg=0.0)
    root, far = Cell(0, 3), Cell(0, 24)
    service.exploring(at=root)
    tree = Tree.rooted(root).with_observation(root, [far]).with_observation(far, [Cell(1, 24)])
    vehicle = replace(service.state.vehicles[1], vertex=far, at_target=False, order=None)
    service.state = replace(service.state, tree=tree).with_vehicle(vehicle)
    here = service.setting.grid.centre_of(root)
    centre = service.setting.grid.to_fixed(service.setting.grid.centre_of(far), 0.0)
    assert service.setting.fence.allows(centre)
    service.track(1, here)
    order = service.order()
    assert not (isinstance(order, FlyTo) and order.cell == far)


def test_cell_that_cannot_be_flown_to_is_abandoned_and_reported() -> None:
    made = mission(square(-10, 16, 40, 20), square(-60, -60, 160, 100), capacity_wh=60.0)
    flight = fleet(made, roi={Cell(0, n) for n in range(5, 14)})
    flight.start()
    flight.run()
    assert flight.faults == []
    assert flight.state.exploration_finished
    assert not flight.state.completed
    assert flight.state.abandoned == {Cell(0, 10)}


# --- other hands -----------------------------------------------------------------------------
def test_vehicle_that_a_pilot_flies_gets_no_order(service: Service) -> None:
    service.take_off()
    assert service.post(Overridden(1, 9.0, "LOITER")) == ((1, StandDown()),)
    stale = (
        Arrived(1, 9.5, HOME),
        Airborne(1, 9.6),
        BatterySwapped(1, 9.7, 60.0),
        frame(1, 9.8, Cell(0, 6), Cell(0, 6)),
    )
    for event in stale:
        assert service.post(event) == ()
        assert service.state.vehicles[1].phase is Phase.YIELDED
    assert not service.state.vehicles[1].at_target


def test_a_pilots_vehicle_on_its_pad_is_down_whatever_height_it_reports(service: Service) -> None:
    """A PX4 moved its home by 1.2 m for two minutes after take-off; the mission never ended."""
    service.take_off()
    service.post(Overridden(1, 20.0, "LAND"), Landed(1, 30.0, 50.0, HOME))
    service.track(1, HOME, height_m=1.2)
    assert service.state.vehicles[1].landed
    assert service.state.is_over


def test_fresh_battery_does_not_start_a_failed_vehicle(service: Service) -> None:
    service.connect()
    service.post(OrderFailed(1, 2.0, "take off", "no arming"))
    assert service.post(BatterySwapped(1, 60.0, 60.0)) == ()
    assert service.state.vehicles[1].phase is Phase.FAILED


def test_vehicle_that_lands_while_the_mission_is_resumed_continues_after_it(
    service: Service,
) -> None:
    service.exploring()
    service.post(Resumed(20.0))
    service.post(Connected(1, 21.0, HOME, HOME, 6.0, True, True, 30.0, mode="land"))
    assert service.order() == Land()
    service.post(Landed(1, 30.0, 29.0, position=HOME))
    assert service.state.vehicles[1].phase is Phase.GROUNDED
    assert service.order() == AwaitBattery()


def found(t_s: float, at: GridPoint = HOME, wh: float = 30.0, home: GridPoint = HOME) -> Connected:
    """Connect to a vehicle on the ground."""
    return Connected(1, t_s, home, at, 0.0, False, True, wh)


FIELD, NEAR = GridPoint(20.0, 20.0), GridPoint(0.0, 7.0)
ON_PAD = [Tracked(1, 19.0, HOME, 6.0, 30.0), Crashed(1, 20.0, HOME, "it fell, 0 m from home")]
LIES, NO_BATTERY = "is still there", "has not been replaced"
CLEARED: dict[str, list[Event]] = {
    "given back": [Overridden(1, 9.0, "LAND"), Landed(1, 30.0, 50.0), Released(1, 60.0, HOME, 0.2)],
    "in contact again": [LinkLost(1, 20.0), found(60.0, wh=58.0)],
    # a real PX4 sets its home to the place of its landing
    "landed afield unheard": [Resumed(59.0), found(60.0, FIELD, 60.0, home=FIELD)],
}


@pytest.mark.parametrize("how", CLEARED)
def test_vehicle_found_on_the_ground_takes_off_once_its_crew_is_clear(
    service: Service, how: str
) -> None:
    service.take_off()
    assert service.post(*CLEARED[how]) == ((1, AwaitBattery()),)
    assert service.post(BatterySwapped(1, 90.0, 60.0)) == ((1, TakeOff(12.0)),)


LYING: dict[str, tuple[list[Event], str]] = {
    # the events, the last where it is found, and the report about it
    "down unheard": ([LinkLost(1, 20.0), found(90.0, FIELD)], LIES),
    "fell": ([Crashed(1, 20.0, FIELD, "it fell"), Resumed(60.0), found(61.0, FIELD)], LIES),
    "fell near": ([Crashed(1, 20.0, NEAR, "it fell"), Resumed(60.0), found(61.0, NEAR)], LIES),
    # it is found where the crew would put it back: a fresh battery shows that they did
    "fell on its pad": ([*ON_PAD, Resumed(60.0), found(61.0, wh=33.0)], NO_BATTERY),
    "fell on its pad unheard": ([*ON_PAD, LinkLost(1, 60.0), found(61.0, wh=33.0)], NO_BATTERY),
    "set down by a failsafe": (
        [Overridden(1, 20.0, "LAND failsafe"), Landed(1, 40.0, 30.0, position=FIELD),
         Resumed(60.0), found(61.0, FIELD)],
        LIES,
    ),
}  # fmt: skip


@pytest.mark.parametrize("how", LYING)
def test_vehicle_that_is_down_is_fetched_and_not_flown(service: Service, how: str) -> None:
    events, message = LYING[how]
    service.exploring()
    assert service.post(*events) == ((1, StandDown()),)
    assert service.state.vehicles[1].phase is Phase.DOWN
    assert message in service.state.vehicles[1].note
    assert service.state.is_over
    service.post(Resumed(200.0))
    left_wh = 30.0 if "set down" in how else 60.0  # nothing broke
    assert service.post(found(201.0, wh=left_wh)) == ((1, AwaitBattery()),), "its crew allows it"


def test_crashed_vehicle_whose_mode_changes_stays_down_until_it_is_mended(
    service: Service,
) -> None:
    service.exploring()
    service.post(Crashed(1, 20.0, HOME, "it fell, 0 m from home"), Overridden(1, 22.0, "TAKEOFF"))
    vehicle = service.state.vehicles[1]
    assert vehicle.phase is Phase.YIELDED
    assert vehicle.away
    assert vehicle.note == "it is down, and yielded to TAKEOFF"
    finished = replace(service.state, surveyed=True, exhausted=True)
    assert not finished.completed
    service.post(Released(1, 60.0, HOME, 0.2))
    assert service.state.vehicles[1].phase is Phase.DOWN
    assert not isinstance(service.order(1), TakeOff)


def test_crashed_vehicle_that_its_pilot_flies_again_is_not_down(service: Service) -> None:
    service.exploring()
    service.post(Crashed(1, 20.0, HOME, "it fell, 0 m from home"), Overridden(1, 22.0, "STABILIZE"))
    service.post(LiftedOff(1, 60.0), Landed(1, 90.0, 40.0, HOME))
    vehicle = service.state.vehicles[1]
    assert not vehicle.was_down
    assert not vehicle.away


def test_vehicle_that_its_pilot_landed_elsewhere_changes_mode_and_is_given_back(
    service: Service,
) -> None:
    service.exploring()
    service.post(Overridden(1, 20.0, "LAND"), Landed(1, 30.0, 50.0, GridPoint(30.0, 0.0)))
    service.post(Overridden(1, 40.0, "LOITER"), Released(1, 60.0, GridPoint(30.0, 0.0), 0.2))
    assert service.state.vehicles[1].phase is Phase.GROUNDED


def test_vehicle_that_is_down_is_not_flown_because_its_pilot_lets_go(service: Service) -> None:
    service.exploring()
    service.post(Crashed(1, 20.0, HOME, "it fell, 0 m from home"))
    assert service.post(Released(1, 21.0, HOME, 0.0)) == ()
    assert service.state.vehicles[1].phase is Phase.DOWN


def test_crashed_vehicle_that_stays_silent_is_still_reported_as_down(service: Service) -> None:
    service.exploring()
    service.post(Crashed(1, 20.0, GridPoint(20.0, 20.0), "it fell"), Resumed(60.0), Resumed(90.0))
    (line,) = aircraft_down(service.state)
    assert line.endswith("it is down: it fell")


def test_box_without_a_lane_ends_with_a_reason(service: Service) -> None:
    """`uavmap check` refuses it; an old journal may still hold one."""
    service.setting = replace(service.setting, lanes=())
    service.state = service.setting.initial_state()
    assert service.connect() == ((1, StandDown()),)
    assert service.state.vehicles[1].phase is Phase.FAILED
    assert "search box" in service.state.vehicles[1].note
    assert service.state.is_over
    assert not service.state.completed


def test_vehicle_given_back_in_the_air_comes_to_rest_and_continues(service: Service) -> None:
    service.take_off()
    service.post(Overridden(1, 9.0, "LOITER"))
    at = GridPoint(3.0, 9.0)
    assert service.post(Released(1, 20.0, at, 12.0)) == ((1, Hold()),)
    service.track(1, at)
    assert isinstance(service.order(), FlyTo)


def test_vehicle_found_in_the_air_with_its_pilot_gets_no_order(service: Service) -> None:
    at = GridPoint(3.0, 9.0)
    found = Connected(1, 1.0, HOME, at, 12.0, True, False, 60.0, mode="LOITER")
    assert service.post(found) == ((1, StandDown()),)
    assert service.state.vehicles[1].phase is Phase.YIELDED
    assert service.track(1, at) == ()
    assert service.post(Released(1, 20.0, at, 12.0)) == ((1, Hold()),)


def test_vehicle_given_back_just_above_the_ground_is_in_the_air(service: Service) -> None:
    service.take_off()
    service.post(Overridden(1, 9.0, "LOITER"))
    service.post(Recalled(12.0), Released(1, 20.0, HOME, 0.6))
    assert service.state.vehicles[1].phase is Phase.AIRBORNE
    assert not service.state.is_over


def test_vehicle_interrupted_while_climbing_counts_as_airborne(service: Service) -> None:
    service.connect()
    service.track(1, HOME, 4.0)
    service.post(Overridden(1, service.now_s + 0.5, "LOITER"))
    assert not service.state.vehicles[1].landed
    assert not service.state.is_over


def test_an_order_that_fails_in_the_air_brings_the_vehicle_home(service: Service) -> None:
    service.take_off()
    service.post(OrderFailed(1, 9.0, "fly to", "denied"))
    assert service.state.vehicles[1].return_reason is ReturnReason.FAULT
    service.track(1, HOME)
    service.track(1, HOME)
    assert service.order() == Land()


def test_link_is_lost_after_the_order_to_take_off_the_vehicle_counts_as_in_the_air(
    pair: Service,
) -> None:
    """It climbed to its layer and hovered there; others entered its column at once."""
    pair.connect(1)
    assert pair.order(1) == TakeOff(12.0)
    pair.post(LinkLost(1, 5.0))
    assert not pair.state.vehicles[1].landed
    pair.connect(2, at=GridPoint(3.0, 0.0))
    assert not isinstance(pair.order(2), TakeOff)
    pair.post(Connected(1, 20.0, HOME, HOME, 0.0, False, True, 60.0))
    assert pair.state.vehicles[1].landed


def test_lost_link_is_reconnected_where_the_vehicle_is(service: Service) -> None:
    service.exploring()
    assert service.post(LinkLost(1, 20.0)) == ((1, StandDown()),)
    here = GridPoint(8.0, 24.0)
    service.now_s = 30.0
    service.connect(at=here, height_m=12.0)
    service.track(1, here)
    assert service.leg().cell == ROOT


def test_vehicle_half_way_down_over_home_lands_without_climbing_first(service: Service) -> None:
    service.exploring()
    low_wh = service.setting.energy.reserve_wh + 1.0
    service.post(Resumed(20.0))
    service.post(Connected(1, 21.0, HOME, HOME, 3.0, True, True, low_wh))
    service.post(Tracked(1, 22.0, HOME, 3.0, low_wh))
    assert service.order() == Land()


# --- coming home -----------------------------------------------------------------------------
def test_the_battery_turns_a_vehicle_back_to_a_swap_and_out_again(service: Service) -> None:
    service.exploring()
    far = service.setting.grid.centre_of(ROOT)
    service.post(Tracked(1, 30.0, far, 12.0, service.setting.energy.reserve_wh + 2.0))
    order = service.leg()
    assert order.route[-1] == HOME
    service.post(Arrived(1, 40.0, HOME))
    assert service.order() == Land()
    service.post(Landed(1, 60.0, 10.0))
    assert service.order() == AwaitBattery()
    assert service.post(BatterySwapped(1, 90.0, 60.0)) == ((1, TakeOff(12.0)),)
    service.post(Airborne(1, 98.0))
    assert service.leg().cell == ROOT


def test_cell_of_a_vehicle_whose_battery_ends_is_observed_by_another(pair: Service) -> None:
    pair.setting = replace(pair.setting, strategy=Stepwise(EXPLORERS["horizon"]))
    pair.state = replace(pair.state, setting=pair.setting)
    last, centre = Cell(2, 7), pair.setting.grid.centre_of
    for vehicle, at in ((1, centre(Cell(2, 3))), (2, centre(ROOT))):
        pair.connect(vehicle, at=GridPoint(8.0 * vehicle, 0.0))
        pair.exploring(vehicle)
        pair.track(vehicle, at, 12.0 if vehicle == 1 else 18.0)
    ahead = replace(pair.state.vehicles[1], vertex=last, at_target=False, order=None)
    behind = replace(pair.state.vehicles[2], order=None)
    tree = Tree.rooted(ROOT).with_observation(ROOT, [last])
    pair.state = replace(pair.state, tree=tree, vehicles={1: ahead, 2: behind})
    pair.track(2, centre(ROOT), 18.0)
    assert pair.order(2) == Hold()
    low_wh = pair.setting.energy.reserve_wh + 2.0
    orders = dict(pair.post(Tracked(1, pair.now_s + 1.0, centre(Cell(2, 3)), 12.0, low_wh)))
    assert pair.state.vehicles[1].return_reason is ReturnReason.BATTERY
    assert isinstance(orders[2], FlyTo)
    assert orders[2].cell == last


def test_vehicle_that_flies_past_a_point_comes_to_rest_before_it_turns_home(
    service: Service,
) -> None:
    """It swings out by the width of the margin; its return is planned from rest."""
    service.take_off()
    leg = service.leg()
    assert not leg.stop
    low_wh = service.setting.energy.reserve_wh + 1.0
    service.post(Arrived(1, 12.0, leg.route[-1]))
    assert isinstance(service.order(), Sweep)
    service.put(1, order=Hold())
    service.post(Tracked(1, 12.5, leg.route[-1], 12.0, low_wh))
    assert service.state.vehicles[1].return_reason is ReturnReason.BATTERY
    assert service.order() == Hold()
    service.post(Tracked(1, 13.5, leg.route[-1], 12.0, low_wh))
    assert isinstance(service.order(), FlyTo)


def test_a_recall_ends_everything_and_a_resume_begins_again(pair: Service) -> None:
    pair.connect_all()
    pair.post(Airborne(1, 8.0), Recalled(9.0))
    assert pair.state.vehicles[1].return_reason is ReturnReason.RECALLED
    assert pair.state.vehicles[2].order == Land(), "its take-off is called off, wherever it is"
    pair.post(Landed(2, 12.0, 59.0))
    assert pair.state.vehicles[2].phase is Phase.FINISHED
    pair.post(Resumed(100.0))
    assert not pair.state.recalled
    assert {v.phase for v in pair.state.vehicles.values()} == {Phase.OFFLINE}


# --- keeping apart ---------------------------------------------------------------------------
def test_vehicle_does_not_climb_through_a_leg_below_its_layer(pair: Service) -> None:
    pair.connect(1)
    leg = FlyTo((GridPoint(30.0, 0.0),), None, stop=True, height_m=12.0)
    pair.fly(1, GridPoint(-30.0, 0.0), order=leg)
    assert pair.connect(2, at=GridPoint(8.0, 0.0)) == ()
    pair.track(1, GridPoint(16.0, 0.0))
    assert pair.order(2) == TakeOff(18.0)


def test_vehicle_does_not_climb_beside_one_whose_stop_is_not_known_yet(pair: Service) -> None:
    pair.connect(1)
    pair.fly(1, HOME, order=Hold(), braking_until_s=9.0)
    assert pair.connect(2, at=GridPoint(8.0, 0.0)) == ()


def test_layers_closer_than_the_buffer_do_not_block_each_other() -> None:
    """Two vehicles that change places would otherwise wait for each other for ever."""
    pair = over(vehicles=2, layer_m=4.5)
    north = Cell(ROOT.east, ROOT.north + 1)
    there, look = pair.setting.grid.centre_of(north), Look(north, 15, 16.5)
    pair.fly(2, there, order=look, lanes=(), vertex=ROOT, remaining_wh=60.0)
    pair.exploring()
    for t in range(5):
        pair.post(frame(1, 20.0 + t, ROOT, ROOT, north))
    assert pair.leg(1).cell == north


def test_vehicle_that_comes_home_for_a_battery_flies_round_one_that_lands(pair: Service) -> None:
    pad = GridPoint(8.0, 0.0)
    pair.connect_all()
    low = ReturnReason.BATTERY
    pair.fly(2, pad, order=Land(), height_m=9.0, return_reason=low, over_home=True)
    pair.fly(1, GridPoint(60.0, 0.0), return_reason=low)
    pair.track(1, GridPoint(60.0, 0.0))
    order = pair.leg(1)
    assert order.route[-1] == HOME
    way = LineString([(60.0, 0.0), *order.route])
    assert way.distance(Point(pad)) >= 6.0
    assert way.length < 75.0


def test_vehicle_in_air_that_a_failsafe_takes_leaves_it_and_comes_back(pair: Service) -> None:
    centre = pair.setting.grid.centre_of
    east = Cell(ROOT.east + 1, ROOT.north)
    pair.connect_all()
    pair.exploring(1)
    tree = Tree.rooted(ROOT).with_observation(ROOT, [east])
    pair.state = replace(pair.state, tree=tree)
    look = Look(east, 30, 18.0)
    pair.fly(2, centre(east), order=look, vertex=east, at_target=True, lanes=(), remaining_wh=60.0)
    pair.post(Overridden(1, pair.now_s + 0.5, "RTL"))
    pair.track(2, centre(east), 18.0)
    order = pair.leg(2)
    assert order.cell is None
    away = LineString([centre(ROOT), HOME]).distance(Point(order.route[-1]))
    assert away >= 6.0
    pair.post(Arrived(2, pair.now_s + 3.0, order.route[-1]))
    assert not pair.state.vehicles[2].at_target
    assert pair.order(2) == Hold()
    pair.post(Landed(1, pair.now_s + 40.0, 40.0, position=HOME))
    assert pair.leg(2).cell == east


def test_apply_does_not_change_the_state_it_is_given(service: Service) -> None:
    service.connect()
    before, text = service.state, repr(service.state)
    apply(before, Airborne(1, 8.0))
    assert repr(before) == text


@pytest.mark.parametrize(
    ("east_m", "message"),
    [(5000.0, "outside the geofence"), (-59.6, "m from the edge of the geofence")],
)
def test_a_vehicle_that_stands_outside_of_the_fence_or_at_its_edge_stays_there(
    service: Service, east_m: float, message: str
) -> None:
    there = GridPoint(east_m, -30.0)
    assert service.post(found(1.0, there, 60.0, home=there)) == ((1, StandDown()),)
    assert message in service.state.vehicles[1].note


def test_autopilot_takes_over_when_not_even_the_return_path_can_be_flown(service: Service) -> None:
    service.take_off()
    service.post(Recalled(9.0))
    far = GridPoint(9.0, 0.0)
    for t_s in (10.0, 16.0):  # it waits, and tries again
        service.post(Tracked(1, t_s, far, 10.0, 50.0))
        assert service.post(OrderFailed(1, t_s + 1.0, "FlyTo", "denied")) == ((1, Hold()),)
        service.post(Tracked(1, t_s + 2.0, far, 10.0, 50.0), Tracked(1, t_s + 4.0, far, 10.0, 50.0))
        assert isinstance(service.state.vehicles[1].order, FlyTo)
    assert service.post(OrderFailed(1, 21.0, "FlyTo", "denied")) == ((1, ReturnToLaunch()),)
    assert not service.state.is_over
    assert service.post(OrderFailed(1, 22.0, "ReturnToLaunch", "denied")) == ()
    assert service.state.vehicles[1].phase is Phase.GUARDED
    assert not service.state.is_over
    service.post(Tracked(1, 59.0, HOME, 0.0, 20.0), Landed(1, 60.0, 20.0, HOME))
    assert service.state.vehicles[1].phase is Phase.FAILED
    assert service.state.is_over


def test_autopilot_returns_over_forbidden_ground_only_after_a_longer_wait() -> None:
    hole = square(20.0, -6.0, 8.0, 12.0)
    service = over(square(-10, 16, 60, 30), holes=[hole])
    service.take_off()
    service.post(Recalled(9.0))
    behind, t_s = GridPoint(44.0, 0.0), 10.0
    for _ in range(MAX_RETURN_ATTEMPTS_AROUND_HOLE):
        service.post(Tracked(1, t_s, behind, 12.0, 50.0), Tracked(1, t_s + 4.0, behind, 12.0, 50.0))
        assert isinstance(service.state.vehicles[1].order, FlyTo)
        assert service.post(OrderFailed(1, t_s + 5.0, "FlyTo", "denied")) == ((1, Hold()),)
        t_s += 6.0
    service.post(Tracked(1, t_s, behind, 12.0, 50.0), Tracked(1, t_s + 4.0, behind, 12.0, 50.0))
    assert service.post(OrderFailed(1, t_s + 5.0, "FlyTo", "no")) == ((1, ReturnToLaunch()),)


def test_vehicle_blown_out_of_the_fence_returns(service: Service) -> None:
    service.take_off()
    service.track(1, GridPoint(0.0, -500.0))
    assert service.state.vehicles[1].return_reason is ReturnReason.FAULT


def test_vehicle_whose_landing_drifts_away_from_its_pad_is_down(service: Service) -> None:
    service.exploring()
    service.post(Recalled(20.0), Landed(1, 60.0, 30.0, position=GridPoint(30.0, 0.0)))
    assert service.state.vehicles[1].phase is Phase.DOWN
    assert service.state.vehicles[1].note.endswith("it landed 30 m from its pad")


@pytest.mark.parametrize(("east_m", "away"), [(1.0, False), (40.0, True)])
def test_vehicle_set_down_elsewhere_by_a_failsafe_is_named(east_m: float, away: bool) -> None:
    """No order landed it, so it does not count as down, but the crew has to fetch it."""
    service = over(capacity_wh=25.0)
    service.exploring()
    service.post(Overridden(1, 30.0, "LAND"))
    service.post(Landed(1, 60.0, 10.0, position=GridPoint(east_m, 0.0)))
    vehicle = service.state.vehicles[1]
    assert vehicle.phase is Phase.YIELDED
    assert vehicle.away is away
    assert ("from its pad" in vehicle.note) is away
    lines = aircraft_down(service.state)
    assert len(lines) == away
    service.post(Released(1, 70.0, GridPoint(east_m, 0.0), 5.0))
    assert not service.state.vehicles[1].landed_away_m


def test_vehicle_set_down_on_higher_ground_by_its_pilot_stands(service: Service) -> None:
    """Heights are above home: a vehicle on a hill is not in the air, and the mission is over."""
    service.connect()
    hill = GridPoint(30.0, 20.0)
    service.post(Airborne(1, 8.0), Overridden(1, 10.0, "LOITER"))
    service.post(Tracked(1, 11.0, hill, 9.0, 50.0), Landed(1, 20.0, 49.0, position=hill))
    assert service.state.is_over
    service.post(Tracked(1, 21.0, hill, 3.0, 49.0))
    assert service.state.vehicles[1].landed
    assert service.state.is_over
    service.post(LiftedOff(1, 30.0))
    assert not service.state.is_over


def until_it_leaves(pair: Service, route: tuple[GridPoint, ...]) -> tuple[float, Order | None]:
    """Return charge and order with which a vehicle leaves, whose return path a silent one blocks.

    The air of a silent vehicle's return stays reserved for as long as its battery may last.
    """
    pair.connect_all()
    above, wall = GridPoint(40.0, 0.0), FlyTo(route, None, stop=True, height_m=12.0)
    pair.fly(1, GridPoint(25.0, 0.0), order=wall if route else Hold())
    pair.fly(2, above, order=Hold())
    pair.post(LinkLost(1, pair.now_s + 1.0))
    pair.post(Recalled(pair.now_s + 2.0))
    pair.now_s += 30.0
    for tenths in range(600, 0, -1):
        pair.now_s += 1.2
        pair.post(Tracked(2, pair.now_s, above, 18.0, tenths / 10.0))
        if not isinstance(pair.order(2), Hold):
            break
    return tenths / 10.0, pair.order(2)


def test_vehicle_whose_return_path_stays_blocked_lands_beside_its_pad(pair: Service) -> None:
    charge_wh, order = until_it_leaves(pair, ())
    assert isinstance(order, FlyTo)
    vehicle = pair.state.vehicles[2]
    assert order.route == (vehicle.spare_pad,)
    assert 8.0 < order.route[-1].distance_to(vehicle.home) < 20.0
    assert charge_wh > pair.setting.energy.home_wh(32.0, 30.0)


def test_vehicle_without_a_clear_place_beside_its_pad_returns_by_its_autopilot(
    pair: Service,
) -> None:
    charge_wh, order = until_it_leaves(pair, (GridPoint(25.0, 70.0), GridPoint(25.0, -70.0)))
    assert isinstance(order, ReturnToLaunch)
    energy = pair.setting.energy
    # as late as the reserve allows: up to 30 m, home, and down
    assert charge_wh > energy.home_wh(32.0, 30.0)
    assert charge_wh < energy.home_wh(32.0, 30.0) + 4.0
    vehicle = pair.state.vehicles[2]
    assert vehicle.phase is Phase.GUARDED
    assert "stayed blocked" in vehicle.note
