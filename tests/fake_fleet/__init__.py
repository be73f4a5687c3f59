"""A fleet without MAVLink that drives `missions.flight.step` in a kind or an unkind world."""

from .fleet import TICK_S, Fleet, fleet

__all__ = ["TICK_S", "Fleet", "fleet"]
