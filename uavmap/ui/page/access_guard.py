"""Access to the page: only for browsers that were opened with its token.

The token comes once, in the URL; then it is a cookie that scripts cannot read. A page of another
origin gets nothing, whatever cookie the browser has. A GIS has no cookies: the map has a token of
its own, which opens nothing else, for a GIS stores it in its projects.
"""

from __future__ import annotations

import hmac
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from uavmap.ui.page.page_pipe import MAP_PATH

REFUSED: Final = "Not allowed: open the URL that uavmap has printed, with its token.\n"
_POLICY: Final = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'"
)
"""Nothing comes from elsewhere: there is no internet in the field, and none is needed."""
_HEADERS: Final = {
    "content-security-policy": _POLICY,
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


class Guard:
    """Before an ASGI application."""

    def __init__(self, app: ASGIApp, token: str, cookie: str, map_token: str | None) -> None:
        self.app = app
        self._token, self._map_token = token, map_token
        self._cookie = cookie
        """Its name: of each port another, for a browser sends them to every port of a host."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what is allowed."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        asked = HTTPConnection(scope)
        given, origin = asked.query_params.getlist("token"), asked.headers.get("origin")
        own = not origin or urlsplit(origin).netloc == asked.headers.get("host", "")
        path = scope["path"] if scope["type"] == "http" and given else ""
        if path == "/" and _same(given[-1], self._token):
            cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Lax"
            entered = Response(None, 303, {"location": "/", "set-cookie": cookie, **_HEADERS})
            await entered(scope, receive, send)
        elif own and (
            _same(asked.cookies.get(self._cookie, ""), self._token)
            or (self._map_token and path == MAP_PATH and _same(given[-1], self._map_token))
        ):
            await self.app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            refused = Response(REFUSED, 403, {"content-type": "text/plain", **_HEADERS})
            await refused(scope, receive, send)


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message.setdefault("headers", [])
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)  # a file of results has a stricter policy
        await send(message)

    return sending
