"""One browser at the page: its rights, and the command that it shows."""

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
from uavmap.ui.page.server import ask

MAX_BYTES: Final = 100_000_000
"""Maximum size of a file that a browser sends, bytes."""
SHOWN_LINES: Final = 14
LISTED_EVERY: Final = 4
"""Number of updates between two reads of the folder."""


class App:
    """The objects that all browsers share."""

    def __init__(
        self, workspace: Workspace, given: Path | None, host: str = LOOPBACK, origin: str = ""
    ) -> None:
        self.workspace = workspace
        self.grounds = Grounds(workspace, given)
        self.host = host
        self.jobs = Jobs(workspace.folder, origin)
        self.controls = Controls()

    def page_words(self, option: str) -> list[str]:
        """Return the options with which a command serves its page to the same network."""
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
        """Numbers of the commands whose page was shown."""
        self._updates: list[Callable[[], None]] = []

    # --- commands ------------------------------------------------------------------------------
    def button(
        self, text: str, act: Callable[[], Awaitable[None] | None], *, grave: bool = False
    ) -> ui.button:
        """Add a button that only works in the browser with the controls.

        Each click has a number that counts once: a double click, or a message that is sent again,
        has no effect.
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
        """Run a command and show it. Raises `UavmapError` if that is impossible."""
        self._job = self.app.jobs.begin(words)
        return self._job

    def on_end(self, command: str, act: Callable[[Sequence[str]], None]) -> None:
        """Call `act` each time that a command has ended well."""
        self._on_end.setdefault(command, []).append(act)

    def on_update(self, act: Callable[[], None]) -> None:
        """Call `act` at every `LISTED_EVERY`th update, for tasks that read folders."""
        self._updates.append(act)

    def holds(self) -> bool:
        """Return whether this browser has the controls."""
        return self.app.controls.are_held_by(self.id)

    def refuse_watcher(self) -> None:
        """Raise `UavmapError` for a browser without the controls."""
        if not self.holds():
            raise UavmapError("another browser has the controls; request them above")

    def upload(self, label: str, endings: Sequence[str], act: Callable[[Any], Any]) -> ui.upload:
        """Add a place for files that the browser sends at once."""
        upload = ui.upload(multiple=True, auto_upload=True, on_upload=act, max_file_size=MAX_BYTES)
        upload.props(f"accept={','.join(endings)} flat bordered").classes("app-wide")
        text = label.replace('"', "")  # the usual header has a button without a name
        upload.add_slot(
            "header",
            f'<q-btn type="a" flat no-caps class="full-width" label="{text}" '
            '@click="props.pickFiles"><q-uploader-add-trigger /></q-btn>',
        )
        return upload

    async def keep(self, event: Any, folder: str = "") -> str | None:
        """Save a file from the browser; return its name, or None if it is refused."""
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
        """Return the address of a file of the workspace, with its time, so that changes load."""
        path = self.app.workspace.folder / name
        return f"/file/{quote(name)}?{int(path.stat().st_mtime) if path.exists() else 0}"

    # --- the frame -----------------------------------------------------------------------------
    def add_controls(self) -> None:
        """Add the line that shows which browser has the controls."""
        controls = self.app.controls
        self._held = ui.label("").classes("app-held").mark("held")
        self._request = ui.button(
            "Request the controls", on_click=lambda: controls.request(self.id)
        )
        self._give = ui.button("Hand over", on_click=lambda: controls.answer(self.id, yes=True))
        self._keep = ui.button("Keep", on_click=lambda: controls.answer(self.id, yes=False))
        for button in (self._request, self._give, self._keep):
            button.props("no-caps flat dense")

    def add_output(self, behind: ui.element) -> None:
        """Add the shown command, its lines, and the frame for its page."""
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
            and await ask(
                "Send Ctrl-C? It ends the command. Aircraft return and land; "
                "a second Ctrl-C leaves that to their autopilots."
            )
            is not None
        ):
            job.interrupt()

    def refresh(self) -> None:
        """Show the changes since the last call."""
        controls = self.app.controls
        controls.note(self.id)
        holds, requested = self.holds(), controls.are_requested
        self._held.set_text(
            "another browser requests the controls" if holds and requested
            else "you have the controls" if holds
            else "you have requested the controls" if controls.are_requested_by(self.id)
            else "another browser has the controls: this one watches"
        )  # fmt: skip
        self._request.set_visibility(not holds and not requested)
        for button in (self._give, self._keep):
            button.set_visibility(holds and requested)
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
        if len(self.app.jobs.all) > self._known:  # show the newest, from any browser
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

    def show(self, job: Job) -> None:
        """Show a command."""
        self._job = job
        self.refresh()

    def select(
        self, label: str, choices: Callable[[], Sequence[str]], none: str | None = None
    ) -> ui.select:
        """Add a choice of files that follows the folder; `none` is the label for no file."""

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
