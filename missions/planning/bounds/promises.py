"""What a strategy promises of the time that it takes."""

from __future__ import annotations

from missions.mapping.tree import Tree
from missions.planning.stepwise import Explorer
from missions.planning.stepwise.metric import Metric


def promised_moves(explorer: Explorer, tree: Tree, robots: int, metric: Metric) -> float | None:
    """What a strategy promises for a final tree, in moves; None where it promises nothing.

    A theorem may speak of some legs or teams only. A strategy with such a one has a method
    `bound_holds(robots, metric)`; the bound of a strategy without it holds with every metric.

    >>> from missions.planning.stepwise.rdfs import Rdfs
    >>> from missions.units import Cell
    >>> tree = Tree.rooted(Cell(0, 0))
    >>> promised_moves(Rdfs(), tree, 2, Metric())
    0.0
    """
    holds = getattr(explorer, "bound_holds", None)
    if holds is not None and not holds(robots, metric):
        return None
    return explorer.bound_moves(len(tree), tree.depth, robots)


def bound_time(moves: float | None, metric: Metric) -> float | None:
    """A bound in moves as a bound in time, None from None.

    Tours are closed: a move and its way back cost at most 2 Sr / (Sr^2 - Sp^2). A vertex is looked
    from once, when it is first reached, so at most every second move ends with a look.

    >>> bound_time(10.0, Metric(speed=1.0, drift_east=0.6, look=2.0))
    25.625
    """
    if moves is None:
        return None
    return moves * (metric.most_per_length + metric.look / 2.0)
