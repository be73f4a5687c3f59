"""uavmap resume: go on with an interrupted mission."""

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
from uavmap.ui.cli.common import EXIT_CODES, agreed, report
from uavmap.ui.cli.flight_options import beside, gives_network, key_file, network_of, not_flown
from uavmap.ui.cli.option_table import add_options

EXAMPLES: Final = f"""\
examples:
  uavmap resume results/runway-1
  uavmap resume results/field-3 --connect udpin://0.0.0.0:14560
  uavmap resume results/field-3 --recover
  uavmap resume results/field-3 --recall
  uavmap resume results/bay-2 --listen 'udp/224.0.0.224:7447#iface=wlan1'
  uavmap resume results/field-3 --page                 a live page in the browser

A simulated flight is repeated up to its last event, each event checked against the journal, and
goes on from there. A real flight goes on from what the journal knows, with the aircraft wherever
they are: who stands on the ground takes off. With --recall nothing takes off: who is in the air
comes home and lands, and the map of what is known is written. Where nothing was flown, as after
a dry run that could not put back what it had set on the autopilots, it puts that back and no more.

{EXIT_CODES}"""
DESCRIPTION: Final = "Go on with the mission of a results folder from its last committed event."


add_arguments: Final = partial(add_options, command="resume")


def run(options: argparse.Namespace) -> int:
    """Resume."""
    folder, terminal = Path(options.folder), Terminal()
    with shown_on(terminal):
        if options.recover:
            _recover(folder, terminal.show)
        ask = agreed if sys.stdin.isatty() and sys.stderr.isatty() else None
        try:
            with beside(options, lambda: _plan(folder), folder, terminal) as onlookers:
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


def _recover(folder: Path, say: Callable[[str], None]) -> None:
    done = recover(folder / JOURNAL)
    if done is None:
        say(f"{folder / JOURNAL}: nothing to recover")
        return
    lost = f"at least {done.lost} lost" if done.lost else "what came after them is lost"
    say(
        f"{folder / JOURNAL}: {done.kept} events kept, {lost}; the damaged journal is "
        f"{done.aside.name}"
    )
