"""The studies of the papers, by name. A new one is a file and a line here."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from uavmap.studies import greedy_table_1, lrv_figure_3, roi_figure_7
from uavmap.studies.study import Study

STUDIES: Mapping[str, Study] = MappingProxyType(
    {study.name: study for study in (roi_figure_7.STUDY, greedy_table_1.STUDY, lrv_figure_3.STUDY)}
)

__all__ = ["STUDIES", "Study"]
"""By the name on the command line."""
