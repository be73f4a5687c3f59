"""A page to paint examples on, served to this computer only.

The address holds a secret. So neither another user of the computer nor another site's page in the
same browser can read pictures or write masks. The page loads nothing from elsewhere.
"""

from __future__ import annotations

import json
import secrets
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any, Final

import cv2

from missions.errors import ImageError, OutputError
from uavmap.base.atomic_write import write_bytes
from uavmap.base.framing import frame_ancestors
from uavmap.base.image_files import decoded
from uavmap.photos.tune.examples import (
    UNDECIDED,
    file_bytes,
    list_pictures,
    read_classes,
    read_picture,
    refuse_same_folder,
)
from uavmap.photos.tune.polygons import SURROUND, UNKNOWN
from uavmap.photos.tune.study import Study

HOST: Final = "127.0.0.1"
MAX_BYTES: Final = 16_000_000
REGION_GRAY: Final = 255
_PAGE: Final = "paint.html"
_POLICY: Final = (
    "default-src 'none'; img-src 'self' blob: data:; connect-src 'self'; "
    "script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors "
)


class Easel:
    """The pictures to paint, and the folder of their masks; `ImageError` without pictures.

    `study` learns from the masks; None if the page is for painting only.
    """

    def __init__(
        self, images: Path, masks: Path, width_px: int, study: Study | None = None
    ) -> None:
        refuse_same_folder(images, masks)
        self.study: Final = study
        self.pictures: Final = list_pictures(images)
        self.masks: Final = masks
        self.width_px: Final = width_px
        self.classes: Final = read_classes(masks)
        self.done: Final = threading.Event()

    def names_painted(self) -> list[dict[str, Any]]:
        """Return the names, and which of them are painted."""
        return [{"name": p.stem, "painted": self._mask(p).exists()} for p in self.pictures]

    def kinds(self) -> list[dict[str, Any]]:
        """Return the kinds of ground to paint: kind, name and gray value in a mask."""
        region = {REGION_GRAY: "region"} if self.classes is None else self.classes.names
        kind = "region" if self.classes is None else "class"
        undecided = UNDECIDED if self.classes is None else UNKNOWN
        return [
            *({"kind": kind, "name": name, "level": level} for level, name in region.items()),
            {"kind": "surround", "name": "surround", "level": SURROUND},
            {"kind": "undecided", "name": "undecided", "level": undecided},
        ]

    def picture(self, index: int) -> bytes:
        """Return a picture at the working width, as JPEG. Raises `ImageError`."""
        _, data = cv2.imencode(".jpg", read_picture(self.pictures[index], self.width_px))
        return bytes(data)

    def mask(self, index: int) -> bytes | None:
        """Return the earlier mask, if any. Raises `ImageError`."""
        path = self._mask(self.pictures[index])
        return file_bytes(path) if path.exists() else None

    def keep(self, index: int, data: bytes) -> str:
        """Write a mask as a grey PNG; return the answer. Raises `ImageError`, `OSError`."""
        path = self._mask(self.pictures[index])
        grey = cv2.cvtColor(decoded(data, path.name), cv2.COLOR_BGR2GRAY)
        _, encoded = cv2.imencode(".png", grey)
        write_bytes(path, bytes(encoded))
        return f"saved {path.name}"

    def _mask(self, picture: Path) -> Path:
        return self.masks / f"{picture.stem}.png"


class _Server(ThreadingHTTPServer):
    """A thread a request."""

    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a browser that disconnects in the middle of an answer."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """One request."""

    server_version = "uavmap"
    sys_version = ""

    def __init__(self, easel: Easel, token: str, *args: Any) -> None:
        self._easel, self._token = easel, token
        super().__init__(*args)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the base class's name
        """Log no request: the address holds the secret."""

    def do_GET(self) -> None:
        """Answer the page, the list, a picture or a mask."""
        try:
            self._send_object(*self._requested())
        except ImageError as error:
            self._send_text(HTTPStatus.UNPROCESSABLE_ENTITY, str(error))

    def _send_object(self, what: str | None, index: int | None) -> None:
        study = self._easel.study
        if what == "":
            page = (resources.files("uavmap.photos.tune") / _PAGE).read_bytes()
            self._answer(HTTPStatus.OK, page, "text/html; charset=utf-8")
        elif what == "pictures":
            self._answer(
                HTTPStatus.OK, json.dumps(self._easel.names_painted()).encode(), "application/json"
            )
        elif what == "kinds":
            self._answer(
                HTTPStatus.OK, json.dumps(self._easel.kinds()).encode(), "application/json"
            )
        elif what == "picture" and index is not None:
            self._answer(HTTPStatus.OK, self._easel.picture(index), "image/jpeg")
        elif what == "mask" and index is not None and (data := self._easel.mask(index)):
            self._answer(HTTPStatus.OK, data, "image/png")
        elif what == "round":
            now = None if study is None else study.round.as_json()
            self._answer(HTTPStatus.OK, json.dumps(now).encode(), "application/json")
        elif (study is not None and what == "map" and (data := study.map())) or (
            study is not None
            and what == "doubtful"
            and index is not None
            and (data := study.doubtful(self._easel.pictures[index]))
        ):
            self._answer(HTTPStatus.OK, data, "image/png")
        elif what in ("mask", "doubtful") and index is not None:
            self._answer(HTTPStatus.NO_CONTENT, b"", "image/png")  # a browser logs a 404
        else:
            self._send_text(HTTPStatus.NOT_FOUND, "not found")

    def do_PUT(self) -> None:
        """Keep a mask."""
        what, index = self._requested()
        length = self.headers.get("Content-Length", "")
        if what != "mask" or index is None:
            self._send_text(HTTPStatus.NOT_FOUND, "not found")
        elif not length.isascii() or not length.isdigit() or int(length) > MAX_BYTES:
            self._send_text(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "a mask of an impossible length")
        else:
            try:
                self._send_text(
                    HTTPStatus.OK, self._easel.keep(index, self.rfile.read(int(length)))
                )
            except ImageError as error:
                self._send_text(HTTPStatus.UNPROCESSABLE_ENTITY, str(error))
            except OSError as error:
                self._send_text(HTTPStatus.INSUFFICIENT_STORAGE, f"not saved: {error.strerror}")

    def do_POST(self) -> None:
        """Learn from the painted examples, or end the painting."""
        what, _ = self._requested()
        if what == "learn" and self._easel.study is not None:
            began = self._easel.study.learn()
            self._send_text(HTTPStatus.OK, "learning" if began else "a round is under way")
        elif what == "done":
            self._send_text(HTTPStatus.OK, "done")
            self._easel.done.set()
        else:
            self._send_text(HTTPStatus.NOT_FOUND, "not found")

    def _requested(self) -> tuple[str | None, int | None]:
        """Return the requested object and its picture; None for a request of another host.

        A page of another site may resolve its own name to this address: the host must be ours.
        """
        port = self.connection.getsockname()[1]
        host, token = self.headers.get("Host", ""), self.path.split("/")[1:2]
        if host not in (f"{HOST}:{port}", f"localhost:{port}"):
            return None, None
        if not token or not secrets.compare_digest(token[0].encode(), self._token.encode()):
            return None, None
        what, _, number = "/".join(self.path.partition("?")[0].split("/")[2:]).partition("/")
        known = number.isascii() and number.isdigit() and len(number) < 9
        index = int(number) if known else -1
        return what, index if 0 <= index < len(self._easel.pictures) else None

    def _send_text(self, status: HTTPStatus, text: str) -> None:
        self._answer(status, text.encode(), "text/plain; charset=utf-8")

    def _answer(self, status: HTTPStatus, data: bytes, kind: str) -> None:
        self.send_response(status)
        for key, value in (
            ("Content-Type", kind),
            ("Content-Length", str(len(data))),
            ("Content-Security-Policy", _POLICY + frame_ancestors()),
            ("Referrer-Policy", "no-referrer"),
            ("X-Content-Type-Options", "nosniff"),
            ("Cache-Control", "no-store"),
        ):
            self.send_header(key, value)
        self.end_headers()
        self.wfile.write(data)


@contextmanager
def served(easel: Easel) -> Iterator[str]:
    """Serve the page at a free port; yield its address."""
    token = secrets.token_urlsafe(24)
    server = _Server((HOST, 0), partial(_Handler, easel, token))
    thread = threading.Thread(target=server.serve_forever, name="paint", daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_address[1]}/{token}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def paint(
    images: Path,
    masks: Path,
    width_px: int,
    show: Callable[[str], None],
    study: Study | None = None,
) -> None:
    """Serve the page until the painter is done (or Ctrl-C, which raises `KeyboardInterrupt`).

    Raises `ImageError` for a folder without pictures, `OutputError` if masks cannot be kept.
    """
    easel = Easel(images, masks, width_px, study)
    try:
        masks.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"--examples {masks} cannot be made: {error.strerror}") from None
    with served(easel) as address:
        show(f"paint at {address} ; masks go into {masks}; end with the button, or Ctrl-C")
        while not easel.done.wait(0.5):
            pass
