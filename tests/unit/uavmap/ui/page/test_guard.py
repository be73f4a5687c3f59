"""Access to the page: its cookie, and pages of other origins; `test_server` has the token."""

import asyncio

import pytest

from uavmap.ui.page.access_guard import Guard

TOKEN = "right"
GOOD = (b"cookie", b"other=1; uavmap-8470=right")


def answered(kind, path="/", query=b"", *headers):
    """Return the messages sent back; None if the guard passed the request on."""
    sent = []
    passed = []

    async def app(scope, receive, send):
        passed.append(scope["type"])
        if kind == "http":
            await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive():
        return {"type": f"{kind}.connect"}

    async def send(message):
        sent.append(message)

    scope = {
        "type": kind,
        "path": path,
        "query_string": query,
        "headers": [(b"host", b"127.0.0.1:8470"), *headers],
    }
    asyncio.run(Guard(app, TOKEN, "uavmap-8470", "map")(scope, receive, send))
    return passed, sent


def test_token_becomes_a_cookie_that_scripts_cannot_read():
    passed, sent = answered("http", "/", b"token=right")
    headers = dict(sent[0]["headers"])
    assert (passed, sent[0]["status"], headers[b"location"]) == ([], 303, b"/")
    assert headers[b"set-cookie"] == b"uavmap-8470=right; Path=/; HttpOnly; SameSite=Lax"


def test_cookie_opens_the_page_and_no_content_comes_from_elsewhere():
    passed, sent = answered("http", "/", b"", GOOD)
    assert passed == ["http"]
    assert b"default-src 'self'" in dict(sent[0]["headers"])[b"content-security-policy"]


@pytest.mark.parametrize(
    "cookie", [b"uavmap-8470=wrong", b"uavmap-8471=right", b"right", b"uavmap-8470=\xff", b"=;,\0"]
)
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_wrong_cookie_is_refused(kind, cookie):
    passed, sent = answered(kind, "/_nicegui_ws/socket.io/", b"token=right", (b"cookie", cookie))
    assert not passed
    assert sent[0].get("status", sent[0].get("code")) in (403, 1008)


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_page_of_another_origin_is_refused_with_any_headers(kind):
    for origin in (b"http://127.0.0.1:3000", b"https://example.org", b"null", b"http://["):
        assert not answered(kind, "/x", b"", GOOD, (b"origin", origin))[0]
    assert answered(kind, "/x", b"", GOOD, (b"origin", b"http://127.0.0.1:8470"))[0] == [kind]


def test_guard_map_token_opens_the_map_and_nothing_else():
    assert answered("http", "/map.geojson", b"token=map")[0] == ["http"]
    for path, query in (
        ("/map.geojson", b"token=wrong"),
        ("/map.geojson", b""),
        ("/", b"token=map"),
        ("/picture/1", b"token=map"),
    ):
        passed, sent = answered("http", path, query)
        assert (passed, sent[0]["status"]) == ([], 403), (path, query)
    assert not answered("websocket", "/map.geojson", b"token=map")[0]
    elsewhere = (b"origin", b"https://example.org")
    assert not answered("http", "/map.geojson", b"token=map", elsewhere)[0]
