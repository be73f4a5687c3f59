"""One referee for all worlds: points, the simulator, fleets, and real autopilots."""

from .forgiveness import FORGIVENESSES
from .referee import Referee
from .rules import AT_THE_END, RULES
from .track import FINE, Ail, Bounds, Charge, Holder, ProductReport, Sample

__all__ = [
    "AT_THE_END",
    "FINE",
    "FORGIVENESSES",
    "RULES",
    "Ail",
    "Bounds",
    "Charge",
    "Holder",
    "ProductReport",
    "Referee",
    "Sample",
]  # fmt: skip
