"""The strategies by name. A new one is a file and a line here."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from missions.explorers.bfdn import Bfdn
from missions.explorers.greedy import Greedy
from missions.explorers.horizon import Horizon
from missions.explorers.hungarian import Hungarian
from missions.explorers.interface import Decision, Explorer, Memory, Situation
from missions.explorers.lrta import Lrta
from missions.explorers.lrv import Lrv
from missions.explorers.random_walk import RandomWalk
from missions.explorers.rdfs import Rdfs
from missions.explorers.rdfs_paper import RdfsPaper
from missions.explorers.smartdfs import SmartDfs

_ALL: tuple[Explorer, ...] = (
    Rdfs(),
    RdfsPaper(),
    Horizon(),
    Hungarian(),
    Greedy(),
    Bfdn(),
    Lrv(),
    Lrta(),
    RandomWalk(),
    SmartDfs(),
)
EXPLORERS: Mapping[str, Explorer] = MappingProxyType({explorer.name: explorer for explorer in _ALL})

__all__ = ["EXPLORERS", "Decision", "Explorer", "Memory", "Situation"]
