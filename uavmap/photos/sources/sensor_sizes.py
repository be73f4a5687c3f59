"""How wide the sensors of common cameras are, where EXIF tells the focal length in mm alone.

The width is that of the pixels across a full-width photograph, as the makers' data sheets give it.
The 35 mm equivalent that the same cameras write is a whole number, good to 2 % at best.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

WIDTH_MM: Mapping[str, float] = MappingProxyType(
    {
        # 1/2.3 inch
        "FC300C": 6.16,
        "FC300S": 6.16,
        "FC300X": 6.16,
        "FC300XW": 6.16,
        "FC330": 6.16,
        "FC350": 6.16,
        "FC220": 6.16,
        # 1 inch
        "FC6310": 13.2,
        "FC6310R": 13.2,
        "FC6310S": 13.2,
        "L1D-20c": 13.2,
        "FC3411": 13.2,
        "XT705": 13.2,
        # four thirds
        "FC550": 17.3,
        "FC6520": 17.3,
        "L2D-20c": 17.3,
        "M3E": 17.3,
        # full frame
        "ZenmuseP1": 35.9,
    }
)
"""By EXIF Model."""
