"""The help of the commands: an example first, and plain words."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import pytest

from tests import prose
from uavmap.ui.cli import COMMANDS, parser


@pytest.fixture(scope="module", autouse=True)
def _columns():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "80")
        yield


def commands_of(made: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    return {
        name: command
        for action in made._actions
        if isinstance(action, argparse._SubParsersAction)
        for name, command in action.choices.items()
    }


def texts_of(made: argparse.ArgumentParser) -> Iterator[str]:
    """Yield description, lines of options and notes of a parser and of those below it."""
    for action in made._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from (str(each.help) for each in action._choices_actions)
        yield action.help or ""
    for block in f"{made.description or ''}\n\n{made.epilog or ''}".split("\n\n"):
        rows = [row for row in block.splitlines() if row.startswith("  ")]
        yield from rows or [block]
    for command in commands_of(made).values():
        yield from texts_of(command)


def test_help_of_uavmap_fits_forty_lines():
    text = parser("").format_help()
    assert len(text.splitlines()) <= 40
    assert all(name in text for name in COMMANDS)


def test_help_of_each_command_begins_with_an_example():
    assert parser("").format_help().startswith("examples:\n  uavmap fly runway --sim ")
    for name, command in commands_of(parser()).items():
        assert command.format_help().startswith(f"examples:\n  uavmap {name}"), name


def test_texts_of_help_have_no_fault_of_prose():
    assert [fault for text in texts_of(parser()) for fault in prose.faults(text)] == []
