"""One browser holds the controls."""

from __future__ import annotations

from uavmap.ui.app.controls import ASK_S, GONE_S, Controls


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def two() -> tuple[Controls, Clock]:
    clock = Clock()
    controls = Controls(clock)
    for visitor in "ab":
        controls.note(visitor)
    return controls, clock


def test_first_browser_holds_the_controls_and_the_second_watches() -> None:
    controls, _ = two()
    assert controls.are_held_by("a")
    assert not controls.are_held_by("b")


def test_holder_hands_over_or_keeps() -> None:
    controls, _ = two()
    controls.request("b")
    assert controls.are_requested_by("b")
    assert controls.are_requested
    controls.answer("b", yes=True)  # only the holder answers
    assert controls.are_held_by("a")
    controls.answer("a", yes=False)
    assert controls.are_held_by("a")
    assert not controls.are_requested
    controls.request("b")
    controls.answer("a", yes=True)
    assert controls.are_held_by("b")
    assert not controls.are_held_by("a")


def test_controls_pass_on_if_the_holder_does_not_answer() -> None:
    controls, clock = two()
    controls.request("b")
    for _ in range(3):
        clock.now_s += ASK_S / 3.0
        controls.note("a")
        controls.note("b")
    assert controls.are_held_by("b")


def test_closed_browser_holds_nothing() -> None:
    controls, clock = two()
    controls.forget("a")
    controls.note("b")
    assert controls.are_held_by("b")
    # one that was only disconnected returns as a watcher
    clock.now_s += GONE_S + 1.0
    controls.note("a")
    assert controls.are_held_by("a")
    controls.note("b")
    assert not controls.are_held_by("b")


def test_browser_that_asked_and_left_gets_nothing() -> None:
    controls, clock = two()
    controls.request("b")
    controls.forget("b")
    clock.now_s += ASK_S
    controls.note("a")
    assert controls.are_held_by("a")
    controls.request("b")  # it asks without being connected
    clock.now_s += GONE_S + ASK_S
    controls.note("a")
    assert controls.are_held_by("a")
