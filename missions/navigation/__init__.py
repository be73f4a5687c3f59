"""Error of the reported position, by what the ground itself says of the way that was flown.

Keyframes are moments at which a position was reported and a picture was taken; links are movements
between two of them that their pictures show. From both follows the error of the reported position,
and whether satellites can be believed. What it is for and how it does: docs/explanation/own-map.md.
"""

from missions.navigation.network import Disagreement, Estimate, ToldErrors
from missions.navigation.track import Track

__all__ = ["Disagreement", "Estimate", "ToldErrors", "Track"]
