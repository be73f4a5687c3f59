"""A browser's tab without a browser: it uses NiceGUI's socket, and keeps a board."""

from __future__ import annotations

import ast
import contextlib
import json
import re
import threading
import time
import uuid
from collections.abc import Callable
from typing import Any
from urllib.parse import urlencode

import httpx
import socketio

from uavmap.ui.page.board import Board

PATIENCE_S = 300.0
_UNESCAPED = {"&amp;": "&", "&lt;": "<", "&gt;": ">", "&#96;": "`", "&#36;": "$"}


class Tab:
    """An open page. `confirms`: whether it confirms the messages that it gets."""

    def __init__(self, url: str, *, confirms: bool = True) -> None:
        self.board = Board()
        self.scene: dict[str, Any] = {}
        self.link: dict[str, Any] = {}
        self.notes: list[str] = []
        self.snapshots = 0
        self.takes = 0
        self.confirms = confirms
        self._news = threading.Condition()
        base = url.partition("/?")[0]
        with httpx.Client(follow_redirects=True) as client:
            page = client.get(url)
            page.raise_for_status()
            self.cookies = dict(client.cookies)
            assert "token" not in str(page.url)
        self.html = page.text
        (query,) = re.findall(r"query: (\{.*?\}),$", page.text, re.MULTILINE)
        (elements,) = re.findall(r"String\.raw`(.*?)`", page.text, re.DOTALL)
        for escaped, plain in _UNESCAPED.items():
            elements = elements.replace(escaped, plain)
        self.elements: dict[str, Any] = json.loads(elements)
        self._query = ast.literal_eval(query)
        self._query.pop("implicit_handshake")
        self._query |= {
            "tab_id": str(uuid.uuid4()), "old_tab_id": "", "document_id": str(uuid.uuid4()),
        }  # fmt: skip
        self._socket = socketio.Client(reconnection=False)
        self._socket.on("run_javascript", self._run)
        self._socket.on("update", self._update)
        self._socket.on("notify", self._notify)
        self._socket.connect(
            f"{base}?{urlencode(self._query)}",
            headers={"Cookie": "; ".join(f"{k}={v}" for k, v in self.cookies.items())},
            transports=["websocket"],
            socketio_path="/_nicegui_ws/socket.io",
            wait_timeout=PATIENCE_S,
        )
        assert self._socket.call("handshake", self._query, timeout=PATIENCE_S)

    def close(self) -> None:
        self._socket.disconnect()

    def wait(self, condition: Callable[[], Any]) -> Any:
        due_s = time.monotonic() + PATIENCE_S
        with self._news:
            while not (found := condition()):
                assert self._news.wait(due_s - time.monotonic()), "waited in vain for the page"
        return found

    # --- what it is told ---------------------------------------------------------------------
    def _run(self, message: dict[str, Any]) -> None:
        found = re.fullmatch(r'return runMethod\(\d+, "(\w+)", (.*)\)', message["code"], re.DOTALL)
        if found is None:
            return
        result = None
        with self._news:
            arguments = json.loads(found[2])
            if found[1] == "setScene":
                (self.scene,) = arguments
            elif found[1] == "applyDelta":
                delta, self.link = arguments
                self.takes += 1
                self.snapshots += delta["since"] == 0
                self.board.apply(delta)
                result = self.board.version
            self._news.notify_all()
        if self.confirms:
            answer = {"request_id": message["request_id"], "result": result}
            with contextlib.suppress(socketio.exceptions.SocketIOError):  # the tab is closed
                self._socket.emit(
                    "javascript_response", answer | {"client_id": self._query["client_id"]}
                )

    def _update(self, message: dict[str, Any]) -> None:
        with self._news:
            message.pop("_id", None)
            for number, element in message.items():
                if element is None:
                    self.elements.pop(number, None)
                else:
                    self.elements[number] = element
            self._news.notify_all()

    def _notify(self, message: dict[str, Any]) -> None:
        with self._news:
            self.notes.append(message.get("message", ""))
            self._news.notify_all()

    # --- what is done in it ------------------------------------------------------------------
    def buttons(self) -> dict[str, str]:
        return {
            number: element["props"]["label"]
            for number, element in self.elements.items()
            if "label" in element.get("props", {}) and "hidden" not in element.get("class", [])
        }

    def press(self, label: str) -> None:
        number = self.wait(
            lambda: next((n for n, text in self.buttons().items() if text == label), None)
        )
        self.event(number, "click")

    def event(self, number: str, kind: str, *arguments: Any) -> None:
        for listener in self.elements[number]["events"]:
            if listener["type"].lower().replace("-", "") == kind:
                told = {
                    "id": int(number),
                    "client_id": self._query["client_id"],
                    "listener_id": listener["listener_id"],
                    "args": [json.dumps(argument) for argument in arguments],
                }
                self._socket.emit("event", told)
