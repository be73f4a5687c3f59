"""uavmap completion: the script that completes commands, options, missions and strategies."""

from __future__ import annotations

import argparse
from typing import Final

import shtab

from missions.mission.checks import FLOWN
from missions.mission.fleet_checks import STRATEGIES as FLEET_STRATEGIES
from uavmap.load.mission_source import shipped_missions

SHELLS: Final = ("bash", "zsh", "fish")

EXAMPLES: Final = """\
  uavmap completion bash > ~/.local/share/bash-completion/completions/uavmap
  uavmap completion zsh > ~/.zfunc/_uavmap      # with fpath+=~/.zfunc before compinit
  uavmap completion fish > ~/.config/fish/completions/uavmap.fish
"""
NOTES: Final = ""
_FOLDERS: Final = ("DIR", "IMAGES")
_FILES: Final = ("AREA", "FILE", "IMAGE", "PATH", "MISSION|DIR")
_MISSIONS: Final = "_uavmap_missions"
"""The shell function that completes a shipped mission or a file."""
DESCRIPTION: Final = "Print the script with which a shell completes commands and options of uavmap."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("shell", choices=SHELLS, help="the shell")


def run(options: argparse.Namespace) -> int:
    """Print the script."""
    from uavmap.ui.cli import parser  # noqa: PLC0415 - it imports this module

    top, names = parser(), " ".join(shipped_missions())
    (commands,) = (a for a in top._actions if isinstance(a, argparse._SubParsersAction))
    for name, command in commands.choices.items():
        for action in command._actions:
            _complete(action, name)
    preamble = {
        "bash": f'{_MISSIONS}() {{ compgen -W "{names}" -- "$1"; compgen -f -- "$1"; }}',
        "zsh": f"{_MISSIONS}() {{ _alternative 'm:mission:({names})' 'f:file:_files' }}",
    }
    print(shtab.complete(top, options.shell, preamble=preamble.get(options.shell, "")))
    return 0


def _complete(action: argparse.Action, command: str) -> None:
    """Set how a value is completed, by its name in the help."""
    named = str(action.metavar)
    if "--strategy" in action.option_strings and command != "simulate":
        action.choices = [*(FLEET_STRATEGIES if command == "onboard" else FLOWN)]
    elif named == "MISSION":
        fish = f"{' '.join(shipped_missions())} {shtab.FILE['fish']}"
        missions = {"bash": _MISSIONS, "zsh": _MISSIONS, "fish": fish}
        action.complete = missions  # type: ignore[attr-defined]
    elif named in _FOLDERS:
        action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
    elif named.startswith(_FILES):
        action.complete = shtab.FILE  # type: ignore[attr-defined]
