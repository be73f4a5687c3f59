"""The memory of one flight for earlier plans."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final, TypeVar

REMEMBERED: Final = 8192
"""Number of answers that are kept, the newest ones."""

T = TypeVar("T")


class PlanMemo:
    """Answers to questions whose answer depends on the question alone."""

    def __init__(self) -> None:
        self._answers: OrderedDict[bytes, Any] = OrderedDict()

    def answer(self, question: bytes, make: Callable[[], T]) -> T:
        """Return the earlier answer, or make it now."""
        if question not in self._answers:
            self._answers[question] = make()
            while len(self._answers) > REMEMBERED:
                self._answers.popitem(last=False)
        found: T = self._answers[question]
        return found
