"""How far the told position is off, by what the ground itself says of the way that was flown.

Keyframes are moments at which a position was told and a picture was taken; links are movements
between two of them that their pictures show. From both follows the error of the told position now,
and whether satellites can be believed. What it is for and how it does: docs/own-map.md.
"""

from missions.navigation.network import Disagreement, Estimate, ToldErrors
from missions.navigation.track import Track

__all__ = ["Disagreement", "Estimate", "ToldErrors", "Track"]
