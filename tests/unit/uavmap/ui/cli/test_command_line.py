"""The command before a command is chosen: quick, and of help."""

from __future__ import annotations

import argparse
import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.said import Gone
from uavmap.ui.cli import COMMANDS, _is_read, main, parser

HEAVY = {"cv2", "numpy", "pydantic", "pymavlink", "rich", "shapely"}


@pytest.mark.parametrize("arguments", [[], ["--help"], ["--version"], ["flyy"]])
def test_nothing_heavy_is_imported_before_a_command_is_chosen(arguments: list[str]) -> None:
    code = (
        "import sys; from uavmap.ui.cli import main\n"
        f"try: main({arguments})\nexcept SystemExit: pass\n"
        "print(sorted(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    imported = run.stdout.splitlines()[-1]
    assert [name for name in HEAVY if f"'{name}'" in imported] == []


def test_alone_it_shows_what_one_can_do(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    shown = capsys.readouterr().out
    assert all(name in shown for name in COMMANDS)


@pytest.mark.parametrize(
    ("wrong", "meant"), [("replya", "did you mean replay?"), ("q", "uavmap --help lists them")]
)
def test_a_misspelt_command_is_guessed(
    wrong: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([wrong])
    assert ended.value.code == 2
    assert meant in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), 141, ""),
        (OSError(errno.ENOSPC, "No space left on device"), 2, "cannot be written: No space left"),
    ],
)
def test_an_output_that_is_gone_is_no_defect(
    error: OSError,
    code: int,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "stdout", Gone(error))
    assert main(["check", "runway"]) == code
    assert said in capsys.readouterr().err


def test_another_pipe_that_breaks_does_not_end_a_command_without_a_word(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(options: object) -> int:
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    monkeypatch.setattr("uavmap.ui.cli._run", broken)
    with pytest.RaisesGroup(BrokenPipeError, allow_unwrapped=True):
        main(["check", "runway"])


def test_a_pipe_that_nobody_reads_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        assert _is_read()
        os.close(reading)
        assert not _is_read()


def test_each_command_has_its_options_alone_and_among_all() -> None:
    def helped(made: argparse.ArgumentParser, name: str) -> str:
        commands = next(iter(made._subparsers._group_actions))  # type: ignore[union-attr]
        return str(commands.choices[name].format_help())  # type: ignore[index]

    together = parser()
    for name in COMMANDS:
        assert helped(parser(name), name) == helped(together, name)
        assert "--help" in helped(together, name)


def test_a_shell_completes_commands_missions_strategies_and_files(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "uavmap.bash"
    script.write_text(capsys.readouterr().out, encoding="utf-8")
    asked = {
        "re": ["resume", "replay", "report"],
        "fly runw": ["runway", "runway-field"],
        "fly runway --strategy sw": ["swath"],
        "fly runway --sp": ["--speedup"],
        "onboard bay --strategy s": ["swath", "survey"],
        "fly uav": ["uavmap.bash"],
    }
    for words, answers in asked.items():
        steps = (
            "source uavmap.bash",
            f"COMP_WORDS=(uavmap {words})",
            f"COMP_CWORD={len(words.split())}",
            "_shtab_uavmap",
            r"""printf '%s\n' "${COMPREPLY[@]}" """,
        )
        run = subprocess.run(
            ["bash", "-c", "; ".join(steps)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        assert run.stdout.split() == answers, run.stderr


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_are_told_the_missions_too(
    shell: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["completion", shell]) == 0
    assert "runway runway-field spill" in capsys.readouterr().out
