"""A stand-in for the process of a page, which keeps its messages."""

from __future__ import annotations

import json

from uavmap.ui.page.board import Board, Delta
from uavmap.ui.page.page_pipe import Message


class Feed:
    """A feed that keeps messages as JSON has them; it is sometimes busy, or breaks at a message."""

    title = "the live page"
    orders_file = -1
    dead = False

    def __init__(self, breaks_at: int = 10**9) -> None:
        self.told: list[tuple[Message, bytes]] = []
        self._asked = 0
        self._breaks_at = breaks_at

    def put(self, words: Message, data: bytes = b"", *, wait_s: float = 0.0) -> bool:
        if len(self.told) >= self._breaks_at:
            raise RuntimeError("the page is broken")
        self.told.append((json.loads(json.dumps(words)), data))
        return True

    @property
    def idle(self) -> bool:
        self._asked += 1
        return self._asked % 5 != 0

    def orders(self) -> list[Message]:
        return []

    @property
    def kinds(self) -> list[str]:
        return [words["kind"] for words, _ in self.told]

    @property
    def deltas(self) -> list[Delta]:
        return [words["delta"] for words, _ in self.told if words["kind"] == "delta"]

    @property
    def board(self) -> Board:
        board = Board()
        for delta in self.deltas:
            board.apply(delta)
        return board
