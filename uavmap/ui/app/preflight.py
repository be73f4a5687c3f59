"""The doctor's findings as a list with remedies; the worst are first."""

from __future__ import annotations

from typing import Final

from nicegui import ui

from uavmap.runner.preflight.finding import Finding, Level
from uavmap.ui.app.jobs import Job
from uavmap.ui.app.visitor import Visitor

COMMAND: Final = "doctor"
COLUMNS: Final = ("", "vehicle", "subject", "found", "expected", "remedy")
_ORDER: Final = (Level.BAD, Level.WARN, Level.OK)
_ENDS: Final = {0: "ready to fly", 3: "do not fly"}
"""Verdicts by the doctor's exit code."""
_LEVELS: Final = {Level.BAD: "bad", Level.WARN: "doubtful", Level.OK: "right"}


def findings_of(job: Job) -> list[Finding]:
    """Return the findings of a doctor so far; the worst are first."""
    found = [finding for line in job.lines() if (finding := Finding.read(line)) is not None]
    return sorted(found, key=lambda finding: _ORDER.index(finding.level))


def verdict_of(found: list[Finding], code: int | None) -> str:
    """Summarise the findings in a line; `code` is the doctor's exit code, None while it runs.

    >>> verdict_of([Finding("GPS", Level.BAD, "no fix")], 3)
    '1 bad, 0 doubtful, 0 right: do not fly'
    >>> verdict_of([Finding("disk", Level.OK, "much")], 2)
    '0 bad, 0 doubtful, 1 right: the check is not complete'
    """
    counts = {level: sum(each.level is level for each in found) for level in _ORDER}
    text = ", ".join(f"{counts[level]} {_LEVELS[level]}" for level in _ORDER)
    if code is None:
        return f"{text}: checking"
    if code not in _ENDS:  # for example, if no vehicle answers
        return f"{text}: the check is not complete"
    return f"{text}: {_ENDS[code]}"


class Findings:
    """The findings of the newest doctor; a row appears with each of its lines."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor
        self._listed: object = None
        self._list = ui.element("div").classes("app-wide").mark("findings")
        visitor.on_update(self._update)

    def _update(self) -> None:
        jobs = [job for job in self._visitor.app.jobs.all if job.words[0] == COMMAND]
        if not jobs:
            return
        job = jobs[-1]
        found = findings_of(job)
        code = job.process.poll()
        listed = job.number, code, found
        if listed == self._listed:
            return
        self._listed = listed
        self._list.clear()
        with self._list:
            if found:
                ui.label(verdict_of(found, code)).classes("app-title")
                _add_table(found)
            elif code is not None:
                ui.label("no findings: the last line below has the reason").classes("app-title")


def _add_table(found: list[Finding]) -> None:
    with ui.element("table").classes("app-findings"):
        with ui.element("tr"):
            for name in COLUMNS:
                with ui.element("th"):
                    ui.label(name)
        for finding in found:
            with ui.element("tr").classes(f"app-{finding.level.value}"):
                number = "" if finding.vehicle is None else str(finding.vehicle)
                cells = (_LEVELS[finding.level], number, finding.what, finding.found,
                         finding.wanted, finding.remedy)  # fmt: skip
                for name, text in zip(COLUMNS, cells, strict=True):
                    with ui.element("td").props(f'data-column="{name}"'):
                        ui.label(text)
