"""The strategies by name. A new one is a file and a line here."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from missions.explorers.horizon import Horizon
from missions.explorers.interface import Decision, Explorer, Memory, Situation
from missions.explorers.rdfs import Rdfs
from missions.explorers.rdfs_paper import RdfsPaper

EXPLORERS: Mapping[str, Explorer] = MappingProxyType(
    {explorer.name: explorer for explorer in (Rdfs(), RdfsPaper(), Horizon())}
)

__all__ = ["EXPLORERS", "Decision", "Explorer", "Memory", "Situation"]
