"""The clock of a fleet: its members count the same seconds, whatever their computers say."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from typing import Final

from missions.flight.setting import Setting
from uavmap.base import messages
from uavmap.fleet.peer import Peer

AGREE_S: Final = 15.0
"""For so long others are listened for before a first take-off."""
_STEP_S: Final = 0.5
ELSEWHERE_CELLS: Final = 0.25
"""Cells that lie farther off than so many of their edges are other ground."""


class FleetClock:
    """How one member's clock stands to those of the others, which are in `peers`."""

    def __init__(
        self,
        setting: Setting,
        number: int,
        peers: Mapping[int, Peer],
    ) -> None:
        self._setting = setting
        self._number = number
        self._peers = peers
        self._log = messages.bound("uavmap.fleet")
        self._strangers: set[int] = set()
        self.begun = False
        """Whether our vehicle has taken off."""
        self.agreed = False
        """Whether our clock is that of the fleet."""

    async def agree(self, wait_s: float) -> float:
        """Listen until all that stand have told the height of their pads, at most `wait_s`; return
        by how much our clock moves on, s.

        It follows the clock of a member that has taken off, else that of the lowest number.
        """
        everybody = set(range(1, len(self._setting.mission.vehicles) + 1)) - {self._number}
        waited_s = 0.0
        while waited_s < wait_s:
            if everybody <= {n for n, p in self._peers.items() if p.pad is not None or p.begun}:
                break
            await asyncio.sleep(_STEP_S)
            waited_s += _STEP_S
        flying = {n: p for n, p in self._peers.items() if p.begun}
        if self.begun and not flying:
            return 0.0
        clocks = {n: p.ahead_s for n, p in (flying or self._peers).items()}
        if not flying:
            clocks[self._number] = 0.0
        if len(clocks) > 1:  # who only listens follows
            clocks.pop(0, None)
        return round(clocks[min(clocks)], 3) if clocks else 0.0

    def moved(self, by_s: float) -> None:
        """Our clock was put forward, or back, by so much: as `agree` said."""
        self.agreed = True
        for peer in self._peers.values():
            peer.clock_moved(by_s)

    def heard(self, peer: Peer, its_s: float, now_s: float, *, begun: bool) -> None:
        """Another has told what its clock says, and whether that moves no more."""
        if begun and not peer.begun:  # its clock may have been moved just now
            peer.ahead_s = -math.inf
        peer.ahead_s = max(peer.ahead_s, its_s - now_s)

    def is_elsewhere(self, sender: int) -> bool:
        """Whether the cells of another are not ours: it began apart, and the region drifts."""
        grid, peer = self._setting.grid, self._peers[sender]
        off_m = abs(peer.ahead_s) * grid.drift_speed_m_s
        elsewhere = self.agreed and peer.begun and off_m > ELSEWHERE_CELLS * grid.cell_m
        if elsewhere and sender not in self._strangers:
            self._strangers.add(sender)
            self._log.info(
                f"vehicle {sender} began apart from us, its clock is {peer.ahead_s:+.0f} s off, "
                "and the region drifts: its cells are other ground, and are not taken"
            )
        return elsewhere
