"""The studies by their name on the command line. A new one is a file and a line here."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from uavmap.lab.studies import (
    greedy_table_1,
    homing_robot,
    leapfrog_study,
    lrv_figure_3,
    roi_bounds,
    roi_figure_7,
    strategy_comparison,
    two_robots,
)
from uavmap.lab.studies.study_model import Study

_MODULES = (
    *(roi_figure_7, roi_bounds, strategy_comparison, greedy_table_1, lrv_figure_3),
    *(homing_robot, two_robots, leapfrog_study),
)
STUDIES: Mapping[str, Study] = MappingProxyType(
    {module.STUDY.name: module.STUDY for module in _MODULES}
)
