"""uavmap completion: what a shell needs to complete commands, options, missions and strategies."""

from __future__ import annotations

import argparse
from typing import Final

import shtab

from missions.mission.checks import FLOWN
from missions.mission.fleet_checks import STRATEGIES as OF_FLEETS
from uavmap.load.mission_source import shipped_missions

SHELLS: Final = ("bash", "zsh", "fish")

EXAMPLES: Final = """\
examples:
  uavmap completion bash > ~/.local/share/bash-completion/completions/uavmap
  uavmap completion zsh > ~/.zfunc/_uavmap      # with fpath+=~/.zfunc before compinit
  uavmap completion fish > ~/.config/fish/completions/uavmap.fish
"""
_FOLDERS: Final = ("DIR", "IMAGES")
_FILES: Final = ("AREA", "FILE", "IMAGE", "PATH", "MISSION|DIR")


DESCRIPTION: Final = "Print the script by which a shell completes uavmap's commands."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("shell", choices=SHELLS, help="the shell that reads it")


def run(options: argparse.Namespace) -> int:
    """Print it."""
    from uavmap.ui.cli import parser  # noqa: PLC0415 - which imports this module, like each command

    top = parser()
    for name, command in _commands(top).items():
        for action in command._actions:
            _complete(action, name)
    print(shtab.complete(top, options.shell, preamble=_preamble().get(options.shell, "")))
    return 0


def _commands(top: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    return next(
        dict(action.choices)
        for action in top._actions
        if isinstance(action, argparse._SubParsersAction)
    )


def _complete(action: argparse.Action, command: str) -> None:
    """Say what a value is, by how the help names it."""
    named = str(action.metavar)
    if "--strategy" in action.option_strings and command != "simulate":
        action.choices = [*(OF_FLEETS if command == "onboard" else FLOWN)]
    elif named == "MISSION":
        action.complete = _missions()  # type: ignore[attr-defined]
    elif named in _FOLDERS:
        action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
    elif named.startswith(_FILES):
        action.complete = shtab.FILE  # type: ignore[attr-defined]


def _missions() -> dict[str, str]:
    """How a mission is completed: a shipped one, or a file."""
    function = "_uavmap_missions"
    fish = f"{' '.join(shipped_missions())} {shtab.FILE['fish']}"
    return {"bash": function, "zsh": function, "fish": fish}


def _preamble() -> dict[str, str]:
    names = " ".join(shipped_missions())
    bash = f'_uavmap_missions() {{ compgen -W "{names}" -- "$1"; compgen -f -- "$1"; }}'
    zsh = f"_uavmap_missions() {{ _alternative 'm:mission:({names})' 'f:file:_files' }}"
    return {"bash": bash, "zsh": zsh}
