"""Pictures that a camera serves over HTTP."""

from __future__ import annotations

import asyncio
import functools
import http.client
import urllib.error
import urllib.request
from typing import Final

from missions.errors import LinkError

FETCH_TIMEOUT_S: Final = 5.0
MAX_PICTURE_BYTES: Final = 64 * 2**20


async def fetch_over_http(url: str) -> bytes:
    """A picture from the camera's own server. Raises `LinkError`."""
    if not url.startswith(("http://", "https://")):
        raise LinkError(f"{url or 'a picture'}: the camera names no http URL for its picture")
    return await asyncio.to_thread(functools.partial(_fetch, url))


def _fetch(url: str) -> bytes:
    try:
        with urllib.request.urlopen(url, timeout=FETCH_TIMEOUT_S) as answer:
            data: bytes = answer.read(MAX_PICTURE_BYTES)
            return data
    except urllib.error.HTTPError as error:
        with error:  # it holds the socket
            raise LinkError(f"{url} cannot be fetched: {error}") from None
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise LinkError(f"{url} cannot be fetched: {error}") from None
