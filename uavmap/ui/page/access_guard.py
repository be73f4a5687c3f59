"""Access to the page: only for browsers that were opened with its token.

The URL has the token once; then it is in a cookie that scripts cannot read. A page of another
origin gets nothing, even if the browser has the cookie. A GIS has no cookies, and stores the URL in
its projects. So the map has its own token, which opens nothing else.
"""

from __future__ import annotations

import hmac
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from uavmap.base.framing import frame_ancestors
from uavmap.ui.page.page_pipe import MAP_PATH

REFUSED: Final = "Not allowed: open the URL that uavmap has printed, with its token.\n"
_POLICY: Final = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data:; base-uri 'none'; form-action 'none'; "
)
"""Policy of the page: it loads only from its server, since the field has no internet."""


def cookie_of(port: int) -> str:
    """Return the name of the cookie: a browser sends its cookies to every port of a host."""
    return f"uavmap-{port}"


class Guard:
    """A check of the token before an ASGI application.

    Args:
        token: Token with all rights.
        cookie: Name of the cookie.
        map_token: Token for the map alone.
        watch_token: Token for watching; the application reads the cookie.
        frames: Sources of the pages that its pages may show in frames.
    """

    def __init__(
        self,
        app: ASGIApp,
        token: str,
        cookie: str,
        map_token: str | None = None,
        watch_token: str | None = None,
        frames: str = "'none'",
    ) -> None:
        self.app = app
        self._tokens = [each for each in (token, watch_token) if each]
        self._map_token = map_token
        self._cookie = cookie
        policy = f"{_POLICY}frame-src {frames}; frame-ancestors {frame_ancestors()}"
        self._headers = {
            "content-security-policy": policy,
            "referrer-policy": "no-referrer",
            "x-content-type-options": "nosniff",
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on an allowed request; refuse others."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        asked = HTTPConnection(scope)
        given, origin = asked.query_params.getlist("token"), asked.headers.get("origin")
        own = not origin or _host_of(origin) == asked.headers.get("host", "")
        path = scope["path"] if scope["type"] == "http" and given else ""
        if path == "/" and self._opens(given[-1]):
            cookie = f"{self._cookie}={given[-1]}; Path=/; HttpOnly; SameSite=Lax"
            entered = Response(None, 303, {"location": "/", "set-cookie": cookie, **self._headers})
            await entered(scope, receive, send)
        elif own and (
            self._opens(asked.cookies.get(self._cookie, ""))
            or (self._map_token and path == MAP_PATH and same(given[-1], self._map_token))
        ):
            await self.app(scope, receive, self._with_headers(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            refused = Response(REFUSED, 403, {"content-type": "text/plain", **self._headers})
            await refused(scope, receive, send)

    def _opens(self, given: str) -> bool:
        return any(same(given, token) for token in self._tokens)

    def _with_headers(self, send: Send) -> Send:
        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                message.setdefault("headers", [])
                headers = MutableHeaders(scope=message)
                for name, value in self._headers.items():
                    headers.setdefault(name, value)  # files of results have a stricter policy
            await send(message)

        return sending


def _host_of(origin: str) -> str | None:
    """Return host and port of an origin; None for one that no browser sends."""
    try:
        return urlsplit(origin).netloc
    except ValueError:
        return None


def same(given: str, token: str) -> bool:
    """Return whether a token is right, in a time that does not depend on it."""
    return hmac.compare_digest(given.encode(), token.encode())
