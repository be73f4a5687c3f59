"""The parts of a replay: votes, damage, order, times."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from missions.events import Vote
from missions.mapping.belief import Belief, FrameId
from missions.units import Cell
from tests.benchmarks.photos.replay import mutations, peak_mb, survives
from tests.unit.uavmap.photos.sources.test_replay_robust import shot
from uavmap.output.drawing.scale import step_near
from uavmap.output.facts.vote_tally import Votes
from uavmap.photos.sources.photo_file import eight_bits
from uavmap.photos.workers import in_order


@pytest.mark.parametrize("seed", range(4))
def test_the_votes_are_those_of_a_belief(seed: int) -> None:
    """Sums are enough where pictures come in the order of their exposure."""
    rng = np.random.default_rng(seed)
    votes, belief = Votes(3, 2), Belief(3, 2)
    for number in range(60):
        vantage = Cell(int(rng.integers(0, 2)), 0)
        said = [
            Vote(Cell(int(east), int(north)), bool(rng.random() < 0.4), 0.5)
            for east, north in {tuple(rng.integers(0, 5, 2)) for _ in range(8)}
        ]
        votes.add(vantage, said)
        frame = FrameId(1, float(number))
        belief = belief.with_frame(vantage, frame, {v.cell: v.positive for v in said})
    assert votes.roi == set(belief.roi)
    found, _ = votes.counted()
    counts = {row.cell: (row.positive, row.votes) for row in found}
    assert counts == {cell: tuple(tally) for cell, tally in belief.cells().items()}


def test_no_damage_is_more_than_a_refusal(tmp_path: Path) -> None:
    data = shot(tmp_path / "a.jpg", 1).read_bytes()
    before = peak_mb()
    outcomes = {survives(bad, tmp_path / "bad.jpg") for bad in mutations(data, 30)}
    assert {"pixels", "used"} <= outcomes
    assert peak_mb() - before < 100.0


def test_the_answers_come_in_the_items_order_and_few_wait() -> None:
    begun: list[int] = []

    def work(number: int) -> int:
        begun.append(number)
        return number

    answers = in_order(work, range(100), workers=3)
    assert [next(answers) for _ in range(5)] == [0, 1, 2, 3, 4]
    assert len(begun) <= 9
    assert list(answers) == list(range(5, 100))


def test_opencv_has_its_threads_back_when_the_last_one_is_done() -> None:
    before = cv2.getNumThreads()
    cv2.setNumThreads(2)
    try:
        one, other = (in_order(abs, range(4), workers=2) for _ in range(2))
        next(one)
        next(other)
        assert list(one) == [1, 2, 3]
        assert cv2.getNumThreads() == 1  # the other is at work still
        assert list(other) == [1, 2, 3]
        assert cv2.getNumThreads() == 2
    finally:
        cv2.setNumThreads(before)


def test_what_a_worker_raises_is_raised() -> None:
    def work(number: int) -> int:
        return 1 // (2 - number)

    with pytest.raises(ZeroDivisionError):
        list(in_order(work, range(9), workers=2))


def test_a_thermal_picture_is_spread_over_its_levels() -> None:
    thermal = np.linspace(7000, 7400, 4000).astype(np.uint16).reshape(40, 100)
    levels = eight_bits(thermal)
    assert levels.shape == (40, 100, 3)
    assert levels.min() == 0
    assert levels.max() == 255
    full = np.linspace(0, 65535, 4000).astype(np.uint16).reshape(40, 100)
    assert (eight_bits(full)[:, :, 0] == full >> 8).all()


def test_cells_are_round_numbers() -> None:
    assert [step_near(m) for m in (0.011, 0.3, 1.4, 1.5, 7.5)] == [0.01, 0.2, 1.0, 2.0, 10.0]
