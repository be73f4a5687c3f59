"""Time to add a frame to the map, by the size of the map; prints a table.

    python -m tests.benchmarks.planning.belief                    200, 2,000 and 20,000 cells
    python -m tests.benchmarks.planning.belief --cells 500 5000   other sizes

The figures are medians of CPU time in microseconds. They are of `Belief.with_frame`, of `FrameSeen`
through `missions.flight.step.step` in a search and in an exploration, and of a `FrameSeen` from
anywhere that shows 15 cells. The last ones are the other events of the exploration: a vehicle
arrives, and the strategy decides where it goes next.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from missions.events import Airborne, Arrived, Connected, Event, FrameSeen, Tracked, Vote
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting
from missions.flight.step import step
from missions.flight.vehicle_state import Phase
from missions.mapping.belief import Belief, FrameId
from missions.mapping.tree import Tree, Vertex
from missions.orders import FlyTo, Look, Order, Sweep, TakeOff
from missions.units import Cell, GridPoint
from tests.benchmarks.frame import cpu_ms, head, options_of, row
from tests.support.small_missions import mission, square

SIZES = (200, 2_000, 20_000)
LOOKS = 40
FRAME_S = 0.25
ALTITUDE_M = 12.0
HOME = GridPoint(0.0, 0.0)


def setting() -> Setting:
    """Return one vehicle, a fence of 1 km x 1 km, and a battery that outlasts the measurement."""
    made = mission(square(-20, 16, 200, 20), square(-100, -100, 1000, 1000), capacity_wh=4000.0)
    return setting_of(made)


def block(cells: int) -> list[Cell]:
    """Return cells in a square that begins north of the start."""
    side = max(round(cells**0.5), 1)
    return [Cell(number % side, 10 + number // side) for number in range(cells)]


def map_region(belief: Belief, cells: list[Cell], *, roi: bool) -> Belief:
    """Return a belief with a frame over each of the cells."""
    for cell in cells:
        seen = dict.fromkeys(cell.cross(), roi)
        belief = belief.with_frame(cell, FrameId(1, 0.0), seen)
    return belief


def frame(t_s: float, vantage: Cell, *positive: Cell) -> FrameSeen:
    """Return a picture over a vantage that shows the cell and its neighbours."""
    votes = tuple(Vote(cell, cell in positive, float(cell in positive)) for cell in vantage.cross())
    return FrameSeen(1, t_s, vantage, votes)


def frame_from_anywhere(t_s: float, corner: Cell) -> FrameSeen:
    """Return a picture without a vantage of five by three cells from their south-west corner."""
    shown = [Cell(corner.east + e, corner.north + n) for e in range(5) for n in range(3)]
    return FrameSeen(1, t_s, None, tuple(Vote(cell, True, 1.0) for cell in shown))


def seen_openly(cells: list[Cell]) -> Belief:
    """Return a belief with a frame from anywhere that showed each of the cells alone."""
    belief = Belief(5, 3)
    for number, cell in enumerate(cells):
        belief = belief.with_frame(None, FrameId(2, -1.0 - number), {cell: True})
    return belief


class Flight:
    """A state, and the CPU time of each event."""

    def __init__(self) -> None:
        self.setting = setting()
        self.state = self.setting.initial_state()
        self.t_s = 1.0

    def post(self, event: Event) -> float:
        """Apply an event; return CPU microseconds."""

        def fold() -> None:
            self.state, _ = step(self.state, event)

        return 1e3 * cpu_ms(fold)

    def order(self) -> Order:
        """Return the order of the vehicle."""
        order = self.state.vehicles[1].order
        assert order is not None
        return order

    def next_s(self) -> float:
        """Return the time of the next event."""
        self.t_s = round(self.t_s + FRAME_S, 3)
        return self.t_s

    def arrive(self) -> float:
        """Fly the leg that was ordered."""
        order = self.order()
        assert isinstance(order, FlyTo)
        grid = self.setting.grid
        place = order.route[-1] if order.cell is None else grid.centre_of(order.cell)
        full_wh = self.setting.energy.capacity_wh
        tracked = self.post(Tracked(1, self.next_s(), place, ALTITUDE_M, full_wh))
        return tracked + self.post(Arrived(1, self.next_s(), place))


def searching(cells: int) -> Flight:
    """Return a vehicle on its first lane, and a map of cells elsewhere that are no ROI."""
    flight = Flight()
    full_wh = flight.setting.energy.capacity_wh
    flight.post(Connected(1, 0.0, HOME, HOME, 0.0, False, True, full_wh))
    assert isinstance(flight.order(), TakeOff)
    flight.post(Tracked(1, 0.5, HOME, ALTITUDE_M, full_wh))
    flight.post(Airborne(1, flight.next_s()))
    flight.arrive()
    assert isinstance(flight.order(), Sweep)
    belief = map_region(flight.state.belief, block(cells), roi=False)
    flight.state = replace(flight.state, belief=belief)
    return flight


def exploring(cells: int) -> Flight:
    """Return a vehicle at the tip of a tree of vertices, before a corridor towards the east.

    The tree is a comb: its root in the south-west corner, a trunk towards the north, rows towards
    the east. All of it was observed but the end of the first row.
    """
    flight = Flight()
    known = set(block(cells))
    root = min(known, key=lambda cell: (cell.north, cell.east))
    tip = Cell(max(cell.east for cell in known) + 1, root.north)
    vertices = {}
    for cell in [*block(cells), tip]:
        parent = Cell(cell.east - 1, cell.north) if cell.east else Cell(0, cell.north - 1)
        depth = cell.east + cell.north - root.north
        vertices[cell] = Vertex(None if cell == root else parent, depth, cell != tip)
    here = flight.setting.grid.centre_of(tip)
    state = replace(
        flight.state,
        belief=map_region(flight.state.belief, block(cells), roi=True),
        tree=Tree.from_vertices(root, vertices),
        found_s=0.0,
    )
    vehicle = replace(
        state.vehicles[1],
        phase=Phase.AIRBORNE, landed=False, vertex=tip, at_target=True, lanes=(),
        position=here, height_m=ALTITUDE_M, remaining_wh=flight.setting.energy.capacity_wh,
    )  # fmt: skip
    flight.state = state.with_vehicle(vehicle)
    flight.post(Tracked(1, flight.next_s(), here, ALTITUDE_M, vehicle.remaining_wh))
    return flight


def frames_alone(cells: int) -> Iterator[float]:
    """Return the microseconds of each `Belief.with_frame`."""
    belief = map_region(Belief(5, 3), block(cells), roi=True)
    for number in range(LOOKS * 5):
        vantage = Cell(-1 - number // 5, 0)
        seen = {cell: cell.north == 0 for cell in vantage.cross()}
        fold = partial(belief.with_frame, vantage, FrameId(1, 10.0 + number), seen)
        yield 1e3 * cpu_ms(fold)
        belief = fold()


def search_frames(flight: Flight) -> Iterator[float]:
    """Return the microseconds of each frame along a lane."""
    start = flight.state.vehicles[1].lanes[0][0]
    cell = flight.setting.grid.cell_of(start)
    for number in range(LOOKS):
        yield flight.post(frame(flight.next_s(), Cell(cell.east + number, cell.north)))


def open_frames(flight: Flight, cells: int) -> Iterator[float]:
    """Return the microseconds of each frame from anywhere over a map of cells."""
    flight.state = replace(flight.state, belief=seen_openly(block(cells)))
    for number in range(LOOKS):
        yield flight.post(frame_from_anywhere(flight.next_s(), Cell(number, 10)))


def exploration(flight: Flight, looks: int = LOOKS) -> Iterator[tuple[bool, float]]:
    """Return for each event along the corridor whether it was a frame, and its microseconds."""
    for _ in range(looks):
        while isinstance(flight.order(), FlyTo):
            yield False, flight.arrive()
        order = flight.order()
        assert isinstance(order, Look), order
        here = order.cell
        ahead, behind = Cell(here.east + 1, here.north), Cell(here.east - 1, here.north)
        while isinstance(flight.order(), Look):
            yield True, flight.post(frame(flight.next_s(), here, here, ahead, behind))


def main() -> None:
    """Print the table."""
    print("CPU microseconds, medians")
    print(head("cells", "with_frame", "search", "anywhere", "exploration", "other events"))
    for cells in options_of(__doc__, cells=SIZES).cells:
        times = list(exploration(exploring(cells)))
        columns = (
            frames_alone(cells),
            search_frames(searching(cells)),
            open_frames(searching(cells), cells),
            (us for is_frame, us in times if is_frame),
            (us for is_frame, us in times if not is_frame),
        )
        print(row(cells, *(f"{statistics.median(us):.1f}" for us in columns)), flush=True)


if __name__ == "__main__":
    main()
