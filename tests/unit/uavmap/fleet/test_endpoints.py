"""Where members of a fleet reach each other, as written on the command line."""

from __future__ import annotations

import pytest

from missions.errors import LinkError
from uavmap.fleet.radio import parse_endpoint


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("tcp/0.0.0.0:7447", "tcp/0.0.0.0:7447"),
        ("udp/drone-2.local:7447", "udp/drone-2.local:7447"),
        ("tcp/[fe80::1]:7447#iface=wlan0", "tcp/[fe80::1]:7447#iface=wlan0"),
        ("udp/224.0.0.224:7447#iface=wlan0", "udp/224.0.0.224:7447#iface=wlan0"),
    ],
)
def test_an_endpoint_comes_back_as_it_was_written(text: str, url: str) -> None:
    assert parse_endpoint("--listen", text).url == url


@pytest.mark.parametrize(
    ("option", "text", "remedy"),
    [
        ("--peer", "192.168.7.2:7447", "write tcp/"),
        ("--peer", "http/drone:80", "write tcp/"),
        ("--peer", "tcp/drone", "write tcp/"),
        ("--peer", "tcp/drone:0", "a port is 1 to 65535"),
        ("--peer", "tcp/drone:70000", "a port is 1 to 65535"),
        ("--peer", "udp/224.0.0.224:7447#iface=wlan0", "--listen udp/224.0.0.224"),
        ("--listen", "udp/224.0.0.224:7447", "#iface=wlan0"),
        ("--listen", "tcp/224.0.0.224:7447#iface=wlan0", "udp/224.0.0.224"),
    ],
)
def test_what_is_none_is_refused_with_a_remedy(option: str, text: str, remedy: str) -> None:
    with pytest.raises(LinkError) as refused:
        parse_endpoint(option, text)
    assert str(refused.value).startswith(f"{option} {text}: ")
    assert remedy in str(refused.value)
