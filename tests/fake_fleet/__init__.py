"""A fleet without MAVLink for driving `missions.flight.step` to the end, in a kind or an unkind
world.
"""

from .fleet import TICK_S, Fleet, fleet

__all__ = ["TICK_S", "Fleet", "fleet"]
