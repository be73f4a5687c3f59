"""The process of a TAK link over real sockets; the tests act as the flight."""

import os
import select
import signal
import socket
import ssl
import subprocess
from contextlib import ExitStack, contextmanager

import pytest

from missions.errors import OutputError, UavmapError
from tests.support.page.board_flight import RING, BoardFlight, record
from tests.support.shown_lines import ShownLines
from tests.support.tak.tak_listener import PATIENCE_S, Listener, until
from uavmap.base.messages import shown_on
from uavmap.ui.tak.tak_feed import open_tak_link

pytest.importorskip("pytak", reason="the link to TAK needs the extra tak")
VEHICLES = 20


class Flight(BoardFlight):
    """Send updates by the real pipe; update `k` is one of vehicle `k % 20 + 1`."""

    def __init__(self, feed):
        super().__init__()
        self.feed, self.version, self.reports = feed, 0, []
        assert feed.put({"kind": "scene", "scene": self.scene}, wait_s=PATIENCE_S)

    def update(self, k):
        name = f"update {k}"
        self.board.set_vehicle(k % VEHICLES + 1, record(doing=name, at_s=k + 1.0, e=float(k)))
        self.send()

    def send(self):
        delta = self.board.since(self.version)
        assert self.feed.put({"kind": "delta", "delta": delta}, wait_s=PATIENCE_S)
        self.version = delta["v"]

    def report(self):
        """Wait for the next report; it may have come with the message before it."""
        while self.silent():
            assert select.select([self.feed.orders_file], [], [], PATIENCE_S)[0]
        return self.reports.pop(0)

    def silent(self):
        self.reports += [words["report"] for words in self.feed.orders()]
        return not self.reports


@contextmanager
def flying(url, **rates):
    with open_tak_link(
        url, simulated=False, **({"aircraft_s": 0.0, "shapes_s": 0.0} | rates)
    ) as feed:
        yield Flight(feed)


def shows(listener, k):
    """Return whether update `k` is the newest of its aircraft there."""
    event = listener.newest.get(f"aircraft-{k % VEHICLES + 1}")
    return event is not None and event.remarks.startswith(f"update {k};")


def arrived(listener):
    """Return the numbers of the updates that have arrived, by aircraft in their order."""
    found = [event for event in listener.events if event.name.startswith("aircraft")]
    return [int(event.remarks.split(";")[0].removeprefix("update ")) for event in found]


def test_link_tcp_with_a_reconnect_every_update_that_was_the_newest_arrives():
    with Listener() as listener:
        with flying(listener.url) as flight:
            flight.cells("explored", *RING)
            for k in range(400):
                flight.update(k)
                listener.wait(lambda k=k: shows(listener, k))
            assert flight.report() == f"TAK: linked: {listener.url}"
            listener.close()
            flight.board.set_field("path 1", [1e9, 100.0, 0.0])
            for k in range(400, 600):  # before a listener exists
                flight.update(k)
            assert flight.report().startswith(f"TAK: the link is lost: {listener.url} (")
            assert sorted(arrived(listener)) == list(range(400))
            listener.open()
            newest = list(range(600 - VEHICLES, 600))
            listener.wait(lambda: all(shows(listener, k) for k in newest))
            listener.wait(lambda: "path-1" in listener.newest)
            for k in range(600, 1000):
                flight.update(k)
                listener.wait(lambda k=k: shows(listener, k))
            assert flight.report() == f"TAK: the link is back: {listener.url}"
            assert flight.silent()
            # the sender introduces itself on each connection: servers take it for the client
            first = [event.name for event in listener.firsts]
            assert first == ["unit", "unit"]
            sent = arrived(listener)
            assert set(sent) == {*range(400), *newest, *range(600, 1000)}
            assert listener.connections == 2
            # on a connection, no aircraft goes back in time
            for vehicle in range(VEHICLES):
                own = [k for k in sent if k % VEHICLES == vehicle]
                assert own == sorted(own)
            flight.board.set_vehicle(1, record(landed=True, at_s=2000.0))
            flight.board.set_field("path 1", [])
            flight.send()
            flight.feed.put({"kind": "ended", "text": "it is over"}, wait_s=PATIENCE_S)
        last = listener.newest
        assert last["aircraft-1"].remarks.startswith("landed; the flight is over")
        assert last["aircraft-1"].stale_s == 60
        assert last["aircraft-2"].remarks.startswith("last known place; the flight is over")
        assert last["region-1"].stale_s == 24 * 3600
        gone = last["path-1-delete"].xml
        assert gone.find("detail/link").attrib["uid"] == last["path-1"].uid
        assert gone.attrib["type"] == "t-x-d-d"


def test_link_1000_updates_without_waiting_end_with_the_newest_of_all():
    """The listener disconnects while events are under way to it."""
    with Listener() as listener, flying(listener.url) as flight:
        for k in range(1000):
            flight.update(k)
            if k == 500:
                listener.close()
                listener.open()
        listener.wait(lambda: all(shows(listener, k) for k in range(980, 1000)))


def test_link_slow_reader_gets_the_newest_and_not_all():
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        with flying(f"tcp://127.0.0.1:{server.getsockname()[1]}") as flight:
            connection, _ = server.accept()
            for k in range(600):  # 340 kB, of which buffers hold a part
                flight.update(k)
            flight.feed.put({"kind": "ended", "text": ""}, wait_s=PATIENCE_S)
            data = b""
            connection.settimeout(PATIENCE_S)
            while b"update 599;" not in data:
                piece = connection.recv(1 << 16)
                assert piece
                data += piece
            connection.close()
    assert data.count(b"</event>") < 500


def test_link_at_its_rates_sends_an_aircraft_once_and_shapes_once():
    with Listener() as listener, flying(listener.url, aircraft_s=60.0, shapes_s=60.0) as flight:
        flight.cells("explored", *RING)
        for k in range(0, 10 * VEHICLES, VEHICLES):
            flight.cells("explored", (10, k))
            flight.update(k)
        flight.update(1)  # another aircraft, at once
        listener.wait(lambda: shows(listener, 1))
        assert len(arrived(listener)) == 2
        assert sum(event.name == "region-1" for event in listener.events) == 1


def test_link_without_a_server_is_reported_once_and_tried_again():
    with socket.socket() as held:  # no other test can listen there meanwhile
        held.bind(("127.0.0.1", 0))
        port = held.getsockname()[1]
        with flying(f"tcp://127.0.0.1:{port}") as flight:
            flight.update(0)
            assert flight.report().startswith(f"TAK: no link yet: tcp://127.0.0.1:{port} (")
            assert flight.silent()


def test_link_udp_sends_whether_anything_listens_or_not():
    with Listener("udp") as listener, flying(listener.url) as flight:
        flight.cells("explored", *RING)
        for k in range(100):
            flight.update(k)
            listener.wait(lambda k=k: shows(listener, k))
        assert {"region-1", "region-1-hole-1"} <= set(listener.newest)
        assert flight.report() == f"TAK: linked: {listener.url}"
        listener.close()
        for k in range(100, 120):
            flight.update(k)
        listener.open()
        for k in range(120, 140):
            flight.update(k)
        listener.wait(lambda: all(shows(listener, k) for k in range(120, 140)))
        assert flight.silent()


# --- certificates --------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    """Make a folder with a key and a self-signed certificate of 127.0.0.1, for both sides."""
    folder = tmp_path_factory.mktemp("certificates")
    subprocess.run(
        [
            "openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256",
            "-nodes", "-days", "2", "-subj", "/CN=localhost",
            "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", "key.pem", "-out", "cert.pem",
        ],
        cwd=folder, check=True, capture_output=True,
    )  # fmt: skip
    return folder


def given(monkeypatch, folder, **more):
    names = {"CLIENT_CERT": "cert.pem", "CLIENT_KEY": "key.pem", "CLIENT_CAFILE": "cert.pem"}
    for name, file in (names | more).items():
        monkeypatch.setenv(f"PYTAK_TLS_{name}", str(folder / file))


def test_link_tls_with_certificates_of_both_sides(certificates, monkeypatch):
    given(monkeypatch, certificates)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificates / "cert.pem", certificates / "key.pem")
    context.load_verify_locations(certificates / "cert.pem")
    context.verify_mode = ssl.CERT_REQUIRED
    with Listener("tls", context) as listener, flying(listener.url) as flight:
        for k in range(40):
            flight.update(k)
            listener.wait(lambda k=k: shows(listener, k))
        assert flight.report() == f"TAK: linked: {listener.url}"


def test_link_tls_server_without_a_trusted_certificate_gets_nothing(certificates, monkeypatch):
    given(monkeypatch, certificates)
    monkeypatch.delenv("PYTAK_TLS_CLIENT_CAFILE")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificates / "cert.pem", certificates / "key.pem")
    with Listener("tls", context) as listener, flying(listener.url) as flight:
        flight.update(0)
        assert "Could not verify" in flight.report()
        assert not listener.events


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("http://127.0.0.1:1", "expected tcp://HOST:PORT"),
        ("tcp://127.0.0.1", "expected tcp://HOST:PORT"),
        ("tcp://127.0.0.1:x", "--tak tcp://127.0.0.1:x: expected"),
        ("127.0.0.1:8087", "expected tcp://HOST:PORT"),
        ("tls://127.0.0.1:1", "PYTAK_TLS_CLIENT_CERT"),
    ],
)
def test_link_url_that_cannot_be_used_is_refused_before_anything_flies(url, why):
    with ExitStack() as stack, pytest.raises(OutputError, match=f"does not start: .*{why}"):
        stack.enter_context(open_tak_link(url, simulated=False))


def test_link_without_pytak_names_the_command_that_installs_it(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with ExitStack() as stack, pytest.raises(UavmapError, match=r"--tak needs pytak: .*pip"):
        stack.enter_context(open_tak_link("tcp://127.0.0.1:1", simulated=False))


def test_link_that_is_killed_is_logged_once_and_the_flight_continues():
    lines = ShownLines()
    with Listener() as listener, shown_on(lines), flying(listener.url) as flight:
        flight.update(0)
        listener.wait(lambda: listener.events)
        os.kill(flight.feed._child.process.pid, signal.SIGKILL)
        until(lambda: flight.feed.orders() == [] and flight.feed.dead)
        for _ in range(3):
            assert not flight.feed.put({"kind": "delta"})
    assert len([line for line in lines if "the TAK link has ended" in line]) == 1
