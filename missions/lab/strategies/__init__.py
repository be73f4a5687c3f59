"""Strategies of papers, for comparison; they register themselves when this is imported."""

from __future__ import annotations

from missions.lab.strategies.bfdn import Bfdn
from missions.lab.strategies.greedy import Greedy
from missions.lab.strategies.hungarian import Hungarian
from missions.lab.strategies.rdfs_paper import RdfsPaper
from missions.lab.strategies.smartdfs import SmartDfs
from missions.lab.strategies.walks import Lrta, Lrv, RandomWalk
from missions.planning.stepwise import EXPLORERS, register

register(RdfsPaper(), Hungarian(), Greedy(), Bfdn(), Lrv(), Lrta(), RandomWalk(), SmartDfs())

__all__ = ["EXPLORERS"]
