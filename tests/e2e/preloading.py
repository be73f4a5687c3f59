"""Modules, kernels and patterns that nearly every run of the command would load again.

They are the commands, the planner's kernels, and the patterns of the ground, which depend on the
seed only. See `preloaded`.
"""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Final

from missions.planning.sweep.memo import warm_up
from uavmap.load.mission_source import load
from uavmap.runner.simulation import make_vehicles
from uavmap.ui import cli

_ANY_MISSION: Final = Path(__file__).resolve().parents[1] / "data" / "speck.toml"
_SEED: Final = 1
"""Default seed of a simulated flight."""

cli.parser()  # imports every command
warm_up()
_world = make_vehicles(load(str(_ANY_MISSION)), _SEED)[0].world
assert _world.ground_texture.size == _world.roi_texture.size
gc.collect()
gc.freeze()
