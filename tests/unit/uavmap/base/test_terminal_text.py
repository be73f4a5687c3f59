"""Text from outside stays text on a terminal."""

from __future__ import annotations

import io
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from missions.events import FrameLost
from missions.flight.setting_of import setting_of
from missions.flight.vehicle_state import Phase
from tests.support.small_missions import mission, square
from uavmap.base.printable import printable
from uavmap.base.terminal import Terminal
from uavmap.runner.operator.progress import ProgressTable


class Tty(io.StringIO):
    def isatty(self) -> bool:
        return True


@given(st.text(max_size=400), st.integers(0, 100))
def test_printable_text_has_no_control_characters(text, limit):
    safe = printable(text, limit)
    assert safe.isprintable()
    assert len(safe) <= max(limit, 3)
    assert printable(safe, limit) == safe


@given(st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=100))
def test_plain_text_is_unchanged(text):
    assert printable(text, 100) == text


def test_bidi_and_zero_width_marks_are_removed():
    marks = "".join(map(chr, (0x200B, 0x200E, 0x202A, 0x202E, 0x2066, 0x2069, 0xFEFF, 0xD800)))
    assert printable(f"a{marks}b") == "ab"


def test_terminal_writes_no_escape_sequences_and_keeps_lines():
    out = io.StringIO()
    Terminal(out).show("      5 s  vehicle 1:\x1b[2J\x1b]0;owned\x07 [/x] gone\nnext\x9b31m line")
    assert out.getvalue() == "      5 s  vehicle 1: [/x] gone\nnext line\n"


def test_note_that_looks_like_markup_breaks_no_table():
    setting = setting_of(mission(square(-10, 16, 40, 30), square(-60, -60, 160, 160)))
    state = setting.initial_state()
    lost = replace(state.vehicles[1], phase=Phase.FAILED, note="[/x] \x1b[2Jrefused [bold]")
    out = Tty()
    terminal = ProgressTable(Terminal(out))
    terminal.begin(setting, again=False)
    event = FrameLost(1, 0.0, "[/y]\x1b]0;owned\x07")
    terminal.notice(event)
    terminal.update(event, state.with_vehicle(lost), 0)
    terminal.end()
    assert "[/x] refused [bold]" in out.getvalue()
    assert "owned" not in out.getvalue()
