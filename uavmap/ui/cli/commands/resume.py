"""uavmap resume: continue an interrupted mission."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from missions.errors import NotFlownError
from uavmap.base.messages import shown_on
from uavmap.base.terminal import Terminal
from uavmap.journal.event_log import Journal
from uavmap.journal.flight_plan import JOURNAL, FlightPlan
from uavmap.journal.recovery import recover
from uavmap.photos.after_flight import draw_ground
from uavmap.runner.flight import plan_of, resume
from uavmap.runner.operator.company import Company
from uavmap.ui.cli import AIRCRAFT_DOWN, complain
from uavmap.ui.cli.common import EXIT_CODES, confirm, report
from uavmap.ui.cli.flight_options import (
    gives_network,
    key_file,
    network_of,
    not_flown,
    onlookers_for,
)
from uavmap.ui.cli.option_table import add_options

EXAMPLES: Final = """\
  uavmap resume results/runway-1
  uavmap resume results/field-3 --connect udpin://0.0.0.0:14560
  uavmap resume results/field-3 --recover
  uavmap resume results/field-3 --recall
  uavmap resume results/bay-2 --listen 'udp/224.0.0.224:7447#iface=wlan1'
  uavmap resume results/field-3 --page                 a live page in the browser
"""
NOTES: Final = f"""\
Real flight: the mission continues from the journal, with the aircraft where they are now. A vehicle
on the ground takes off. With --recall no vehicle takes off: those in the air return and land, and
the map is written.

Simulated flight: it is repeated up to its last event and compared with the journal, then it
continues.

Before the first flight: if a dry run could not restore the settings of the autopilots, the command
restores them, and does nothing else.

{EXIT_CODES}"""
DESCRIPTION: Final = "Continue the mission of a results folder from its last event."


add_arguments: Final = partial(add_options, command="resume")


def run(options: argparse.Namespace) -> int:
    """Resume the mission."""
    folder, terminal = Path(options.folder), Terminal()
    with shown_on(terminal):
        if options.recover:
            _recover(folder, terminal.show)
        ask = confirm if sys.stdin.isatty() and sys.stderr.isatty() else None
        try:
            with onlookers_for(options, lambda: _plan(folder), folder, terminal) as onlookers:
                summary = resume(
                    folder,
                    Company(onlookers=onlookers, ask=ask, recall=options.recall),
                    urls=tuple(options.connect or ()),
                    driver=options.driver,
                    cameras=tuple(options.camera or ()),
                    key_file=key_file(options),
                    forward=None if options.forward is None else tuple(options.forward),
                    network=partial(network_of, options) if gives_network(options) else None,
                    from_home=options.from_home,
                )
        except NotFlownError as over:
            return not_flown(over)
        code = report(summary, folder, as_json=options.json, verbose=options.verbose)
        if not options.recall and code != AIRCRAFT_DOWN:
            draw_ground(folder, complain)
        return code


def _plan(folder: Path) -> FlightPlan:
    with Journal.open(folder / JOURNAL) as journal:
        return plan_of(journal)


def _recover(folder: Path, show: Callable[[str], None]) -> None:
    done = recover(folder / JOURNAL)
    if done is None:
        show(f"{folder / JOURNAL}: nothing to recover")
        return
    lost = f"at least {done.lost} are lost" if done.lost else "all later events are lost"
    show(
        f"{folder / JOURNAL}: {done.kept} events are kept, {lost}; the damaged journal is "
        f"{done.aside.name}"
    )
