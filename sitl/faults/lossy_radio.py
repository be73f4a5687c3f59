"""A bad radio: frames are lost, doubled, late, overtaken or garbled, as a seed has it.

Pure: frames go in with the time, and come out when they are due. Times are the vehicle's.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass

import numpy as np

_OVERTAKEN_S = 0.1  # how far behind a frame falls that others overtake
_SOON_S = 1e-6
_MAX_WAITING = 20_000


@dataclass(frozen=True, slots=True)
class LinkQuality:
    """What happens to the frames of one direction.

    `loss`, `duplicate`, `reorder`, `corrupt` are probabilities for each frame. Frames come
    `delay_s` late, and up to `jitter_s` more, in order; a reordered one is held back until others
    have passed it. `silent`: nothing comes at all, nor what was under way.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    corrupt: float = 0.0
    silent: bool = False

    def __post_init__(self) -> None:
        shares = (self.loss, self.duplicate, self.reorder, self.corrupt)
        if not all(0.0 <= share <= 1.0 for share in shares):
            raise ValueError(f"loss, duplicate, reorder and corrupt are 0 to 1: {self}")
        if not (0.0 <= self.delay_s <= 3600.0 and 0.0 <= self.jitter_s <= 3600.0):
            raise ValueError(f"delay_s and jitter_s are 0 to 3600: {self}")

    def worse(self, other: LinkQuality) -> LinkQuality:
        """Both at once: the larger of each.

        >>> LinkQuality(loss=0.2).worse(LinkQuality(loss=0.1, delay_s=0.5)).loss
        0.2
        """
        return LinkQuality(*map(max, astuple(self), astuple(other)))


CLEAN = LinkQuality()


class Lossy:
    """One direction of one link.

    >>> radio = Lossy([1])
    >>> radio.put([b"one", b"two"], LinkQuality(delay_s=0.2), now_s=0.0)
    >>> radio.due(0.1), radio.due(0.2)
    ([], [b'one', b'two'])
    """

    def __init__(self, seed: Sequence[int]) -> None:
        self._rng = np.random.default_rng(list(seed))
        self._waiting: list[tuple[float, int, bytes]] = []
        self._count = 0
        self._last_s = 0.0  # when the newest frame in order arrives: none behind it comes earlier

    @property
    def idle(self) -> bool:
        """Nothing is under way."""
        return not self._waiting

    def put(self, frames: Iterable[bytes], quality: LinkQuality, now_s: float) -> None:
        """Frames begin their way at `now_s`; a queue that is too long loses them."""
        for frame in frames:
            # all fates are drawn for each frame, so that one setting does not shift another's
            lost, doubled, overtaken, garbled, late, where = self._rng.random(6).tolist()
            if quality.silent or lost < quality.loss:
                continue
            if frame and garbled < quality.corrupt:
                frame = _garble(frame, where)
            due_s = now_s + quality.delay_s + late * quality.jitter_s
            if overtaken < quality.reorder:
                due_s += max(_OVERTAKEN_S, quality.jitter_s)
            else:
                due_s = self._last_s = max(self._last_s, due_s)
            for _ in range(2 if doubled < quality.duplicate else 1):
                if len(self._waiting) < _MAX_WAITING:
                    heapq.heappush(self._waiting, (due_s, self._count, frame))
                    self._count += 1

    def due(self, now_s: float) -> list[bytes]:
        """The frames that arrive until `now_s`, in the order of their arrival."""
        arrived = []
        while self._waiting and self._waiting[0][0] <= now_s + _SOON_S:
            arrived.append(heapq.heappop(self._waiting)[2])
        return arrived

    def drop(self) -> None:
        """Lose all that is under way."""
        self._waiting.clear()


def _garble(frame: bytes, where: float) -> bytes:
    """One byte changed; the place decides the value too."""
    at = int(where * len(frame))
    flip = 1 + int(where * 7919.0 * len(frame)) % 255
    return frame[:at] + bytes([frame[at] ^ flip]) + frame[at + 1 :]
