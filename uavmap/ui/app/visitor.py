"""One browser at the page: what it may do, and the command that it looks at."""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from nicegui import ui

from missions.errors import UavmapError
from uavmap.ui.app.controls import Controls
from uavmap.ui.app.frame import Frame
from uavmap.ui.app.grounds import Grounds
from uavmap.ui.app.jobs import Job, Jobs
from uavmap.ui.app.workspace import Workspace
from uavmap.ui.page.feed import LOOPBACK
from uavmap.ui.page.server import asked

MOST_BYTES: Final = 100_000_000
"""Of a file that a browser sends."""
SHOWN_LINES: Final = 14
LISTED_EVERY: Final = 4


class App:
    """What all browsers share."""

    def __init__(
        self, workspace: Workspace, given: Path | None, host: str = LOOPBACK, origin: str = ""
    ) -> None:
        self.workspace = workspace
        self.grounds = Grounds(workspace, given)
        self.host = host
        self.jobs = Jobs(workspace.folder, origin)
        self.controls = Controls()

    def page_words(self, option: str) -> list[str]:
        """Return the words that have a command serve a page to those that this one is served to."""
        return [option, "0", *(("--page-host", self.host) if self.host != LOOPBACK else ())]


class Visitor:
    """One open page."""

    def __init__(self, app: App) -> None:
        self.app = app
        self.id = secrets.token_hex(8)
        self._job: Job | None = app.jobs.all[-1] if app.jobs.all else None
        self._known = len(app.jobs.all)
        self._beats = 0
        self._ended: set[int] = {job.number for job in app.jobs.all if not job.runs}
        self._on_end: dict[str, list[Callable[[Sequence[str]], None]]] = {}
        self._buttons: list[ui.button] = []
        self._framed: set[int] = set()
        """Commands whose page was shown."""
        self._updates: list[Callable[[], None]] = []

    # --- commands ------------------------------------------------------------------------------
    def button(
        self, text: str, act: Callable[[], Awaitable[None] | None], *, grave: bool = False
    ) -> ui.button:
        """Add a button that only the holder of the controls may press.

        Each click has a number that counts once: a double click, or a message that is sent again,
        does nothing.
        """
        look = "color=red-10" if grave else "color=grey-9"
        button = ui.button(text).props(f"no-caps outline {look}")

        def number() -> None:
            button.props["data-click"] = secrets.token_hex(8)
            button.update()

        async def press(event: Any) -> None:
            if event.args != button.props["data-click"]:
                return
            number()
            try:
                self.refuse_watcher()
                if (waits := act()) is not None:
                    await waits
            except UavmapError as error:
                ui.notify(str(error))

        number()
        button.on("click", press, js_handler="(e) => emit(e.currentTarget.dataset.click)")
        self._buttons.append(button)
        return button

    def run(self, words: Sequence[str]) -> Job:
        """Run a command and show it. Raises `UavmapError` where that cannot be."""
        self._job = self.app.jobs.begin(words)
        return self._job

    def on_end(self, command: str, act: Callable[[Sequence[str]], None]) -> None:
        """Do something each time that a command has ended well."""
        self._on_end.setdefault(command, []).append(act)

    def on_update(self, act: Callable[[], None]) -> None:
        """Do something at every `LISTED_EVERY`th update: what reads folders."""
        self._updates.append(act)

    def holds(self) -> bool:
        """Return whether this browser holds the controls."""
        return self.app.controls.held_by(self.id)

    def refuse_watcher(self) -> None:
        """Raise `UavmapError` for a browser without the controls."""
        if not self.holds():
            raise UavmapError("another browser holds the controls; ask for them above")

    def upload(self, label: str, endings: Sequence[str], act: Callable[[Any], Any]) -> ui.upload:
        """Add a place for files that the browser sends at once."""
        taken = ui.upload(multiple=True, auto_upload=True, on_upload=act, max_file_size=MOST_BYTES)
        taken.props(f"accept={','.join(endings)} flat bordered").classes("app-wide")
        words = label.replace('"', "")  # the usual header has a button without a name
        taken.add_slot(
            "header",
            f'<q-btn type="a" flat no-caps class="full-width" label="{words}" '
            '@click="props.pickFiles"><q-uploader-add-trigger /></q-btn>',
        )
        return taken

    async def keep(self, event: Any, folder: str = "") -> str | None:
        """Keep a file that the browser has sent; return its name, None where it is refused."""
        try:
            self.refuse_watcher()
            path = self.app.workspace.place_for(folder, event.file.name)
        except UavmapError as error:
            ui.notify(str(error))
            return None
        path.parent.mkdir(exist_ok=True)
        await event.file.save(path)
        return path.name

    def file_url(self, name: str) -> str:
        """Return the address of a file of the workspace, with its time: a new one is loaded."""
        path = self.app.workspace.folder / name
        return f"/file/{quote(name)}?{int(path.stat().st_mtime) if path.exists() else 0}"

    # --- the frame -----------------------------------------------------------------------------
    def add_controls(self) -> None:
        """Add the line that says which browser holds the controls."""
        controls = self.app.controls
        self._held = ui.label("").classes("app-held").mark("held")
        self._ask = ui.button("Ask for the controls", on_click=lambda: controls.ask(self.id))
        self._give = ui.button("Hand over", on_click=lambda: controls.answer(self.id, yes=True))
        self._keep = ui.button("Keep", on_click=lambda: controls.answer(self.id, yes=False))
        for button in (self._ask, self._give, self._keep):
            button.props("no-caps flat dense")

    def add_output(self, behind: ui.element) -> None:
        """Add the command that is looked at, its lines, and the frame for its page."""
        with behind, ui.element("div").classes("app-output"):
            with ui.row().classes("app-row"):
                self._shown = ui.label("").classes("app-command").mark("command")
                self._state = ui.label("").mark("state")
                self._page = ui.button("Open its page", on_click=self._open).mark("page")
                self._page.props("no-caps outline color=grey-9")
                self._stop = self.button("Ctrl-C", self._interrupt, grave=True).mark("ctrl-c")
            self._lines = ui.label("").classes("app-lines").mark("lines")
        self._frame = Frame(behind)

    def _open(self) -> None:
        job = self._job
        if job is not None and (url := job.page(steers=self.holds())) is not None:
            self._frame.open(job, url)

    async def _interrupt(self) -> None:
        job = self._job
        if (
            job is not None
            and await asked(
                "Ctrl-C ends a command. Aircraft come home and land; "
                "a second Ctrl-C leaves them to their autopilots."
            )
            is not None
        ):
            job.interrupt()

    def refresh(self) -> None:
        """Show what is new."""
        controls = self.app.controls
        controls.seen(self.id)
        holds, asked_s = self.holds(), controls.asked_s()
        self._held.set_text(
            "another browser asks for the controls" if holds and asked_s is not None
            else "you hold the controls" if holds
            else "you have asked for the controls" if controls.asks(self.id)
            else "another browser holds the controls: this one watches"
        )  # fmt: skip
        self._ask.set_visibility(not holds and asked_s is None)
        for button in (self._give, self._keep):
            button.set_visibility(holds and asked_s is not None)
        self._buttons = [button for button in self._buttons if not button.is_deleted]
        for button in self._buttons:
            button.set_enabled(holds)
        self._refresh_job()
        for job in self.app.jobs.all:
            if not job.runs and job.number not in self._ended:
                self._ended.add(job.number)
                if job.process.poll() == 0:
                    for act in self._on_end.get(job.words[0], ()):
                        act(job.words)
        self._beats += 1
        if self._beats % LISTED_EVERY == 1:
            for update in self._updates:
                update()

    def _refresh_job(self) -> None:
        if len(self.app.jobs.all) > self._known:  # the newest is shown, whoever began it
            self._known, self._job = len(self.app.jobs.all), self.app.jobs.all[-1]
        job = self._job
        self._stop.set_visibility(job is not None and job.runs)
        self._frame.refresh()
        page = None if job is None else job.page(steers=self.holds())
        self._page.set_visibility(page is not None)
        if job is None:
            self._shown.set_text("no command yet")
            return
        self._frame.follow(job, page)
        if page is not None and job.number not in self._framed and self.holds():
            self._framed.add(job.number)
            self._open()
        self._shown.set_text(job.shown)
        self._state.set_text(job.state)
        self._lines.set_text("\n".join(job.lines()[-SHOWN_LINES:]))

    def look_at(self, job: Job) -> None:
        """Show a command."""
        self._job = job
        self.refresh()

    def select(
        self, label: str, choices: Callable[[], Sequence[str]], none: str | None = None
    ) -> ui.select:
        """Add a choice of files whose list follows the folder; `none` is how no file is called."""

        def listed() -> dict[str, str]:
            return ({} if none is None else {"": none}) | {name: name for name in choices()}

        def first(options: dict[str, str]) -> str | None:
            return next(iter(options), None)

        options = listed()
        chosen = ui.select(options, value=first(options), label=label).classes("app-wide")

        def update() -> None:
            now = listed()
            if now != chosen.options:
                chosen.set_options(now, value=chosen.value if chosen.value in now else first(now))

        self.on_update(update)
        return chosen
