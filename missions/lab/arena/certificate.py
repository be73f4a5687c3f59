"""The certificate of an exploration: its makespan between lower bound and promise."""

from __future__ import annotations

from dataclasses import dataclass

from missions.lab.arena.arena_run import Comms, Run
from missions.lab.arena.radio import Links
from missions.planning.bounds.lower_bounds import LowerBounds, drift_lower_bound, flight_lower_bound
from missions.planning.stepwise import Explorer
from missions.planning.stepwise.interface import bound_time, promised_moves
from missions.planning.stepwise.metric import Metric

_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Certificate:
    """A makespan between its bounds; all times in the same unit."""

    makespan: float
    lower_bound: float
    """No team is faster on this ROI."""
    bound: float | None
    """The strategy's promise for this ROI; None without one."""
    tree_depth: int
    cells: int

    @property
    def bound_held(self) -> bool | None:
        """Whether the strategy kept its promise; None without one."""
        if self.bound is None:
            return None
        return self.makespan <= self.bound * (1.0 + _ROUNDING)


def certify(
    run: Run,
    explorer: Explorer,
    robots: int,
    metric: Metric,
    static: LowerBounds,
    comms: Comms | Links = Comms.SHARED,
) -> Certificate:
    """The certificate of a run in the arena that explored the whole ROI.

    `static` holds the bounds for steps to neighbours; straight flight has its own. Strategies
    promise for teams that share what they know: other teams walk into what is explored already,
    and get no bound, nor does a case that `promised_moves` excludes.
    """
    tree = run.tree
    lower = flight_lower_bound(tree.vertices, tree.root, robots, metric)
    if not metric.straight:
        lower = max(lower, drift_lower_bound(static.moves(robots), metric))
    shared = comms is Comms.SHARED
    moves = promised_moves(explorer, tree, robots, metric) if shared else None
    return Certificate(
        makespan=run.makespan,
        lower_bound=lower,
        bound=bound_time(moves, metric),
        tree_depth=tree.depth,
        cells=len(tree),
    )
