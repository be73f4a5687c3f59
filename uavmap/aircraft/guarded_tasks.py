"""Orders in the guardian's terms: a path, a height, an estimated time."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Final

from missions.geo.braking import Course
from missions.guardian import Task
from missions.mission.energy import CLIMB_SPEED_M_S
from missions.mission.layout import Layout
from missions.orders import FlyPath, FlyTo, Hold, Land, Look, Order, Sweep, TakeOff
from missions.units import GridPoint
from uavmap.aircraft.reporter import Reporter

SETTLE_S: Final = 5.0
"""Time to start, and to come to rest, s."""


class GuardedTasks:
    """The tasks of one vehicle, from its present position."""

    def __init__(self, reporter: Reporter, setting: Layout) -> None:
        self._reporter = reporter
        self._view = reporter.view
        self._setting = setting
        self._course: Course | None = None
        """Course of the path that is flown, if any."""

    def task(self, order: Order) -> Task:
        """Return the task of an order that is given now."""
        if not isinstance(order, FlyPath):
            self._course = None
        task = Task("ground", self._reporter.now_s(), name=type(order).__name__)
        match order:
            case FlyPath():
                return self._along(order)
            case TakeOff(height_m):
                here = self._reporter.position()
                return replace(task, doing="climb", path=(here,), height_m=height_m)
            case Land():
                return replace(task, doing="land")
            case FlyTo():
                return self.leg(order)
            case Hold():  # it flies on until it has received the order
                return replace(task, doing="hold", height_m=self._view.height_m)
            case Look(height_m=height_m) | Sweep(height_m=height_m):  # its camera starts first
                here, drift_m_s = self._reporter.position(), self._setting.grid.drift_speed_m_s
                return replace(
                    task, doing="hold", path=(here,), height_m=height_m, drift_m_s=drift_m_s
                )
        return task

    def first_task(self, order: Order, target: GridPoint) -> Task:
        """Return the task of an order whose first target was acknowledged now."""
        if isinstance(order, FlyTo | Sweep):
            return self.leg(order)
        if isinstance(order, Hold):  # braking takes it beyond, and it comes back
            path = (self._reporter.position(), target)
            since_s, height_m = self._reporter.now_s(), self._view.height_m
            return Task("hold", since_s, path, height_m=height_m, name="Hold")
        return self.task(order)

    def _along(self, order: FlyPath) -> Task:
        """Return the task of a path from its beginning on, and until then the path before it."""
        since_s = self._reporter.now_s()
        plan, before = order.trajectory, self._course
        self._course = Course((plan,)) if before is None else before.then(plan, since_s)
        drift_m_s = self._setting.grid.drift_speed_m_s
        return Task(
            "path", since_s, height_m=order.height_m, drift_m_s=drift_m_s,
            name=type(order).__name__, course=self._course,
        )  # fmt: skip

    def leg(self, order: Order) -> Task:
        """Return the task of a leg that begins now."""
        since_s, grid = self._reporter.now_s(), self._setting.grid
        points: tuple[GridPoint, ...] = ()
        height_m = self._view.height_m
        if isinstance(order, Sweep):
            points, height_m = (order.end,), order.height_m
        elif isinstance(order, FlyTo):
            points, height_m = order.route, order.height_m
            if order.cell is not None:
                points = (*points, grid.to_fixed(grid.centre_of(order.cell), since_s))
        path = (self._reporter.position(), *points)
        climb_s = abs(height_m - self._view.height_m) / CLIMB_SPEED_M_S
        homeward = isinstance(order, FlyTo) and order.cell is None and order.stop
        estimate_s = self._flown_in_s(path) + climb_s + SETTLE_S
        return Task(
            "leg", since_s, path, homeward, height_m, estimate_s, grid.drift_speed_m_s,
            type(order).__name__,
        )  # fmt: skip

    def _flown_in_s(self, path: tuple[GridPoint, ...]) -> float:
        energy = self._setting.energy
        level_s = sum(energy.leg_s(a.distance_to(b)) for a, b in itertools.pairwise(path))
        return level_s + self._setting.ups_and_downs_m(path) / CLIMB_SPEED_M_S
