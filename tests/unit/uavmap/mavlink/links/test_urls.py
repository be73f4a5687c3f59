import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions.errors import LinkError
from uavmap.mavlink.links.urls import Endpoint, parse_url

ACCEPTED = [
    ("udpin://0.0.0.0:14540", "udpin", "0.0.0.0", 14540),
    ("udpin:127.0.0.1:14550", "udpin", "127.0.0.1", 14550),
    ("udp://127.0.0.1:14550", "udpin", "127.0.0.1", 14550),
    ("udp:127.0.0.1:14550", "udpin", "127.0.0.1", 14550),
    ("udpin://[::1]:14550", "udpin", "::1", 14550),
    ("udpout://192.168.1.12:14550", "udpout", "192.168.1.12", 14550),
    ("udpout:copter.local:14550", "udpout", "copter.local", 14550),
    ("tcpout://192.168.1.12:5760", "tcpout", "192.168.1.12", 5760),
    ("tcp://192.168.1.12:5760", "tcpout", "192.168.1.12", 5760),
    ("tcp:localhost:5760", "tcpout", "localhost", 5760),
    ("tcpin://0.0.0.0:5760", "tcpin", "0.0.0.0", 5760),
    ("tcpin:0.0.0.0:5760", "tcpin", "0.0.0.0", 5760),
    ("serial:///dev/ttyACM0:57600", "serial", "/dev/ttyACM0", 57600),
    ("serial:///dev/ttyUSB1", "serial", "/dev/ttyUSB1", 57600),
    ("/dev/ttyACM0,115200", "serial", "/dev/ttyACM0", 115200),
    ("/dev/ttyACM0", "serial", "/dev/ttyACM0", 57600),
    ("serial://COM3:57600", "serial", "COM3", 57600),
    ("COM3,921600", "serial", "COM3", 921600),
    ("  udp:127.0.0.1:14550\n", "udpin", "127.0.0.1", 14550),
]


@pytest.mark.parametrize(("url", "transport", "host", "port"), ACCEPTED)
def test_url_of_either_style_is_read(url, transport, host, port):
    endpoint = parse_url(url)
    assert (endpoint.transport, endpoint.host, endpoint.port) == (transport, host, port)


@pytest.mark.parametrize(
    ("url", "remedy"),
    [
        ("", "write udpin://0.0.0.0:14550"),
        ("14550", "write udpin://0.0.0.0:14550"),
        ("udp", "write udpin://0.0.0.0:14550"),
        ("udpin://0.0.0.0", "write udpin://0.0.0.0:14550"),
        ("http://10.0.0.1:80", "write udpin://0.0.0.0:14550"),
        ("tcpout://10.0.0.1:port", "write udpin://0.0.0.0:14550"),
        ("udpout://0.0.0.0:14550", "listen with udpin://0.0.0.0:14550"),
        ("udpout:0.0.0.0:14550", "listen with udpin://0.0.0.0:14550"),
        ("tcp:0.0.0.0:5760", "listen with tcpin://0.0.0.0:5760"),
        ("udpin://:14550", "write udpin://0.0.0.0:14550"),
        ("udp::14550", "write udpin://0.0.0.0:14550"),
        ("udpin://[]:14550", "write udpin://0.0.0.0:14550"),
        ("udpin://0.0.0.0:0", "between 1 and 65535"),
        ("udpin://0.0.0.0:65536", "between 1 and 65535"),
        ("serial:///dev/ttyACM0:0", "positive"),
        ("/dev/ttyACM0,0", "positive"),
        *(
            (f"udpin://0.0.0.0:14550?{which}", "system=N")
            for which in ("system=0", "system=256", "system=", "sys=1", "", "system=1&x=2")
        ),
    ],
)
def test_refused_url_is_named_with_a_remedy(url, remedy):
    with pytest.raises(LinkError) as caught:
        parse_url(url)
    assert remedy in str(caught.value)
    assert repr(url) in str(caught.value)
    assert "\n" not in str(caught.value)


names = st.from_regex(r"[a-z0-9]([a-z0-9.-]{0,20}[a-z0-9])?", fullmatch=True)
addresses = st.one_of(st.ip_addresses(v=4).map(str), st.ip_addresses(v=6).map(str), names)
endpoints = st.one_of(
    st.builds(Endpoint, st.sampled_from(["udpin", "tcpin"]), addresses, st.integers(1, 65535)),
    st.builds(
        Endpoint,
        st.sampled_from(["udpout", "tcpout"]),
        addresses.filter(lambda a: a not in ("0.0.0.0", "::")),
        st.integers(1, 65535),
    ),
    st.builds(
        Endpoint,
        st.just("serial"),
        st.from_regex(r"/dev/[A-Za-z0-9/_-]{1,20}", fullmatch=True),
        st.integers(300, 3_000_000),
    ),
)


@given(endpoints)
def test_url_of_an_endpoint_is_read_back(endpoint):
    assert parse_url(endpoint.url) == endpoint
    if endpoint.transport != "serial":
        assert parse_url(endpoint.url.replace("://", ":", 1)) == endpoint
    else:
        assert parse_url(f"{endpoint.host},{endpoint.port}") == endpoint


@given(st.text(max_size=40))
def test_arbitrary_text_is_an_endpoint_or_a_link_error(url):
    with contextlib.suppress(LinkError):
        parse_url(url)
