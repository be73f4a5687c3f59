"""A whole simulated flight beside a TAK server, a stand-in that checks each event."""

import json

import pytest
from shapely.geometry import Polygon, shape

from tests.e2e import rig
from tests.support.tak.tak_listener import Listener

pytest.importorskip("pytak", reason="the link to TAK needs the extra tak")


def test_flight_with_tak_is_the_same_flight_and_all_of_it_arrives(tmp_path):
    alone, beside = tmp_path / "alone", tmp_path / "beside"
    rig.fly(rig.mission("speck"), alone)
    with Listener() as listener:
        rig.fly(rig.mission("speck"), beside, "--tak", listener.url)
        last = listener.newest
    assert rig.bodies(alone) == rig.bodies(beside)
    assert last["aircraft-1"].remarks.startswith("simulated; landed; the flight is over")
    assert last["aircraft-1"].xml.find("detail/contact").attrib["callsign"].startswith("SIM ")
    features = json.loads((beside / "map.geojson").read_text("utf-8"))["features"]
    (outline,) = [f for f in features if f["properties"]["kind"] == "outline"]
    sent = Polygon([(lon, lat) for lat, lon in last["region-1"].points])
    assert sent.symmetric_difference(shape(outline["geometry"])).area < 1e-3 * sent.area
    assert "complete" in last["region-1"].remarks
    assert last["track-1"].points


def test_flight_continues_without_a_server_and_not_with_a_wrong_url(tmp_path):
    with Listener() as listener:
        url = listener.url
    flight = rig.uavmap("fly", rig.mission("speck"), "--sim", "--tak", url, "--out", tmp_path / "a")
    assert flight.code == 0
    assert flight.err.count("TAK: no link yet") == 1
    assert "the end of the flight was not sent" in flight.err
    wrong = rig.uavmap("fly", rig.mission("speck"), "--sim", "--tak", "tcp://x", "--out", tmp_path)
    assert wrong.code == 2
    assert "expected tcp://HOST:PORT" in wrong.err
    fleet = rig.uavmap("fly", "bay", "--sim", "--comms", "free", "--tak", url)
    assert (fleet.code, "--comms" in fleet.err) == (2, True)
