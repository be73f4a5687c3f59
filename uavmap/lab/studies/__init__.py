"""The studies by their name on the command line. A new one is a file and a line here."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from uavmap.lab.studies import (
    greedy_table_1,
    homing_robot,
    lrv_figure_3,
    roi_bounds,
    roi_figure_7,
    two_robots,
)
from uavmap.lab.studies import (
    leapfrog_study as leapfrog,
)
from uavmap.lab.studies import (
    strategy_comparison as strategies,
)
from uavmap.lab.studies.study_model import Study

_MODULES = (
    *(roi_figure_7, roi_bounds, strategies, greedy_table_1, lrv_figure_3),
    *(homing_robot, two_robots, leapfrog),
)

STUDIES: Mapping[str, Study] = MappingProxyType(
    {module.STUDY.name: module.STUDY for module in _MODULES}
)

__all__ = ["STUDIES", "Study"]
