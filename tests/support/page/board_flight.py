"""A flight as a page or a TAK link sees it: a scene and a board, without vehicles."""

from __future__ import annotations

from typing import Any

from missions.flight.setting_of import setting_of
from tests.support.plans import named_text, plan_of
from uavmap.ui.page.board import Board
from uavmap.ui.page.live_map import LiveMap
from uavmap.ui.page.page_scene import STATES, scene_of


def record(**changed: Any) -> dict[str, Any]:
    """Return the record of a vehicle on a board."""
    flying = {
        "e": 0.0, "n": 0.0, "up": 12.0, "amsl_m": 512.0, "battery": 80.0, "left_s": 600,
        "phase": "airborne", "doing": "flying", "landed": False, "at_s": 1.0,
    }  # fmt: skip
    return flying | changed


class BoardFlight:
    """A board of the mission `runway`, 4 m cells."""

    def __init__(self) -> None:
        plan = plan_of("runway", named_text("runway").text)
        self.scene = scene_of(setting_of(plan.mission))
        self.board = Board()
        self.board.set_field("t_s", 0.0)
        self.board.set_field("phase", "exploring")

    def cells(self, state: str, *places: tuple[int, int]) -> None:
        for place in places:
            self.board.set_cell(place, STATES.index(state))  # type: ignore[arg-type]

    def live(self) -> LiveMap:
        return LiveMap.from_board(self.scene, self.board.since(0))


RING = [(e, n) for e in range(3) for n in range(3) if (e, n) != (1, 1)]
"""Eight cells around one."""
