"""The page of a command within the page of the app: it covers all, with a button Back.

A closed frame stays active behind the page: the alarms of a flight sound in every tab.
"""

from __future__ import annotations

from typing import Any, Final

from nicegui import ui

from uavmap.ui.app.jobs import Job

_OVER: Final = "inert"


class Frame:
    """One frame over the page `behind`, which ignores keys meanwhile."""

    def __init__(self, behind: ui.element) -> None:
        self._behind = behind
        self._job: Job | None = None
        self._url = ""
        self._whole = ui.element("div").classes("app-frame").props('role="dialog"').mark("frame")
        with self._whole:
            with ui.row().classes("app-frame-bar"):
                ui.button("Back", on_click=self.close).props("no-caps outline color=grey-9").mark(
                    "back"
                )
                self._title = ui.label("").classes("app-command")
                self._state = ui.label("").classes("app-held")
                self._alone = ui.link("open in a new tab", "", new_tab=True)
            self._inside: Any = ui.element("iframe").classes("app-frame-page")
            self._inside.props('title="page of the command" allow="autoplay"')
        self._whole.set_visibility(False)

    def open(self, job: Job, url: str) -> None:
        """Show the page of a command."""
        self._job = job
        self.follow(job, url)
        self._whole.set_visibility(True)
        self._behind.props(_OVER)

    def close(self) -> None:
        """Close the frame."""
        self._whole.set_visibility(False)
        self._behind.props(remove=_OVER)

    def follow(self, job: Job, url: str | None) -> None:
        """Show another address of the shown command, if it has changed."""
        if job is self._job and url is not None and url != self._url:
            self._url = url
            for element, name in ((self._inside, "src"), (self._alone, "href")):
                element.props[name] = url
                element.update()

    def refresh(self) -> None:
        """Show the state of the command."""
        if self._job is not None:
            self._title.set_text(self._job.shown)
            self._state.set_text(self._job.state)
