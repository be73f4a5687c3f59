"""The key of a fleet: of a file that every member has, and of the mission that it flies.

The file is one of `uavmap keys new`. It may be the one that signs MAVLink, too: what comes out here
tells nothing of it. Members whose missions differ in what facts mean (grid, box, votes), or in
which air is whose (pads, heights, layers), have different keys: none takes another's for its own.
"""

from __future__ import annotations

import json
from hashlib import blake2s
from typing import Final

from missions.mission.schema import Mission

LABEL: Final = b"uavmap fleet 1"
_MEANING: Final = (
    *("strategy", "start", "search", "fence", "grid", "flight", "votes", "drift", "team"),
)


def fleet_key(key: bytes, mission: Mission) -> bytes:
    """What the datagrams of a fleet are sealed with: 32 bytes, of the key of a file."""
    return blake2s(LABEL + meaning_of(mission), key=key).digest()


def meaning_of(mission: Mission) -> bytes:
    """What has to be the same in the missions of all members: 32 bytes."""
    # a height may be a word, "auto", which is no number to warn of
    told = mission.model_dump(mode="json", include=set(_MEANING), warnings=False)
    told["pads"] = [vehicle.home for vehicle in mission.vehicles]
    return blake2s(json.dumps(told, sort_keys=True).encode()).digest()
