"""uavmap from Python. The package `uavmap` has the same names: `uavmap.fly` and so on."""

from __future__ import annotations

import missions.lab.strategies  # noqa: F401 - the strategies of papers register themselves
from uavmap.load.strategy_source import load_strategies
from uavmap.ui.api.flying import fly, fly_async, resume, resume_async
from uavmap.ui.api.replaying import replay
from uavmap.ui.api.results import Results, open_results

__all__ = ["Results", "fly", "fly_async", "open_results", "replay", "resume", "resume_async"]

load_strategies()
