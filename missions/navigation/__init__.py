"""Error of the reported position, by pictures of the ground along the flight.

Keyframes are moments with a reported position and a picture. Links are movements between two of
them that their pictures show. Both give the error of the reported position, and show whether
satellites can be trusted. docs/explanation/own-map.md describes purpose and method.
"""

from missions.navigation.network import Disagreement, Estimate, ReportedErrors
from missions.navigation.track import Track

__all__ = ["Disagreement", "Estimate", "ReportedErrors", "Track"]
