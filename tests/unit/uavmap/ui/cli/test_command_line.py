"""The command line before a command is chosen: quick and helpful."""

import errno
import os
import signal
import subprocess
import sys
import tomllib

import numpy as np
import pytest

from missions.planning.stepwise import EXPLORERS
from tests.e2e.rig import ROOT, command, environment
from tests.support.shown_lines import BrokenStream
from uavmap import __main__ as door
from uavmap.mavlink.vehicle_view import SIMULATOR_IDENTITY
from uavmap.ui import cli
from uavmap.ui.cli import COMMANDS, _has_reader, main, parser
from uavmap.ui.cli.commands import strategies


def ended(words, *, check=True, **options):
    return subprocess.run(words, capture_output=True, text=True, timeout=60, check=check, **options)


HEAVY = {"cv2", "numpy", "pydantic", "pymavlink", "rich", "shapely"}


@pytest.mark.parametrize("arguments", [[], ["--help"], ["--version"], ["flyy"]])
def test_command_line_imports_nothing_heavy_before_a_command(arguments):
    code = (
        "import sys; from uavmap.ui.cli import main\n"
        f"try: main({arguments})\nexcept SystemExit: pass\n"
        "print(sorted(sys.modules))"
    )
    imported = ended([sys.executable, "-c", code]).stdout.splitlines()[-1]
    assert [name for name in HEAVY if f"'{name}'" in imported] == []


def test_command_line_without_a_command_lists_the_commands(capsys):
    assert main([]) == 2
    shown = capsys.readouterr().out
    assert all(name in shown for name in COMMANDS)


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [("replya", "did you mean replay?"), ("q", "uavmap --help lists the commands")],
)
def test_misspelt_command_is_guessed(wrong, meant, capsys):
    with pytest.raises(SystemExit) as ended:
        main([wrong])
    assert ended.value.code == 2
    assert meant in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "expected"),
    [
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), 141, ""),
        (OSError(errno.ENOSPC, "No space left on device"), 2, "cannot be written: No space left"),
    ],
)
def test_output_that_is_gone_is_no_defect(error, code, expected, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdout", BrokenStream(error))
    assert main(["check", "runway"]) == code
    assert expected in capsys.readouterr().err


def test_broken_pipe_elsewhere_is_not_hidden(monkeypatch):
    def broken(options):
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    monkeypatch.setattr("uavmap.ui.cli._run", broken)
    with pytest.RaisesGroup(BrokenPipeError, allow_unwrapped=True):
        main(["check", "runway"])


def test_pipe_without_a_reader_is_noticed(monkeypatch):
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        assert _has_reader()
        os.close(reading)
        assert not _has_reader()


def test_command_has_the_same_options_alone_and_among_all():
    def helped(made, name):
        commands = next(iter(made._subparsers._group_actions))
        return str(commands.choices[name].format_help())

    together = parser()
    for name in COMMANDS:
        assert helped(parser(name), name) == helped(together, name)
        assert "--help" in helped(together, name)


def test_shell_completes_commands_missions_strategies_and_files(capsys, tmp_path):
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
        run = ended(["bash", "-c", "; ".join(steps)], cwd=tmp_path)
        assert run.stdout.split() == answers, run.stderr


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_complete_missions(shell, capsys):
    assert main(["completion", shell]) == 0
    assert "runway runway-field slick spill" in capsys.readouterr().out


def test_exit_code_is_that_of_the_command(monkeypatch):
    monkeypatch.setattr(cli, "main", lambda: 3)
    assert door.main() == 3


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize(("arguments", "code"), [(["--help"], 0), (["flyy"], 2)])
def test_console_script_signal_after_its_last_line_keeps_its_exit_code(arguments, code, number):
    """One signal comes before the interpreter resets handled signals, one after that."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    module, function = project["scripts"]["uavmap"].split(":")
    program = f"""
import atexit, os, sys
press = lambda kill=os.kill, pid=os.getpid(): kill(pid, {int(number)})
class Late:
    def __del__(self, press=press):
        press()
atexit.register(press)
late = Late()
sys.argv = ["uavmap", *{arguments}]
from {module} import {function}
sys.exit({function}())
"""
    done = ended([sys.executable, "-c", program], env=environment(), check=False)
    assert done.returncode == code
    assert "KeyboardInterrupt" not in done.stderr


def test_ctrl_c_while_the_command_loads_is_a_line(monkeypatch, capsys):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "main", interrupted)
    assert door.main() == 130
    assert capsys.readouterr().err == "uavmap: interrupted\n"


@pytest.mark.parametrize(("fates", "code"), [([], 2), (["vehicle 1: left to its autopilot"], 4)])
def test_computer_without_memory_is_a_line(fates, code, monkeypatch, capsys):
    def too_much(options):
        try:
            return len(np.zeros(1 << 58))
        except MemoryError as error:
            failed = ExceptionGroup("tasks", [error])
            for fate in fates:  # as of a flight that has failed
                failed.add_note(fate)
            raise failed from None

    monkeypatch.setattr(strategies, "run", too_much)
    assert cli.main(["strategies"]) == code
    first, *rest = capsys.readouterr().err.splitlines()
    assert first.startswith("uavmap: this computer has too little memory")
    assert rest == [f"uavmap: {fate}" for fate in fates]


@pytest.mark.parametrize("columns", [30, 40, 60, 75, 80, 120])
def test_strategies_are_listed_in_whole_words(columns, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(columns))
    assert cli.main(["strategies"]) == 0
    told = capsys.readouterr().out
    assert max(map(len, told.splitlines())) <= columns
    words = {word for line in told.splitlines() for word in line.replace("│", " ").split()}
    for name, explorer in EXPLORERS.items():
        assert name in words
        assert set(explorer.when.split()) <= words


def test_module_of_the_same_name_in_the_working_folder_is_not_imported(tmp_path):
    (tmp_path / "vision.py").write_text("raise SystemExit('this is not ours')")
    (tmp_path / "missions").mkdir()
    done = ended(command("check", "runway"), cwd=tmp_path, env=environment(), check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_real_flight_imports_nothing_of_the_simulator():
    code = (
        "import sys, uavmap.ui.cli, uavmap.runner.flight\n"
        "print([name for name in sys.modules if name.split('.')[0] == 'sitl'])"
    )
    assert ended([sys.executable, "-c", code], env=environment()).stdout.strip() == "[]"


def test_simulator_has_its_own_identity():
    from sitl.mavlink.telemetry import IDENTITY  # noqa: PLC0415 - not above the other test

    assert IDENTITY == SIMULATOR_IDENTITY
