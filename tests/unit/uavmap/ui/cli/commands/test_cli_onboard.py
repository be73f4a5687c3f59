"""Refusals of `uavmap onboard` and `uavmap resume` for impossible options."""

import pytest

from tests.support.small_missions import mission_text, square
from uavmap.mavlink.links.signing import new_key
from uavmap.ui.cli import main

URL = "udpin://127.0.0.1:1"
GROUP = "udp/224.0.0.224:7447#iface=lo"


@pytest.fixture
def field(tmp_path):
    file = tmp_path / "field.toml"
    box, fence = square(-6.0, 12.0, 28.0, 16.0), square(-20.0, -14.0, 56.0, 62.0)
    pads = [(0.0, 0.0), (16.0, 0.0)]
    file.write_text(mission_text(box, fence, vehicles=2, homes=pads, strategy="swath"), "utf-8")
    new_key(tmp_path / "fleet.key")
    return file


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--vehicle", "3", "--connect", URL], "there is no vehicle 3, it has 2"),
        (["--vehicle", "2"], "no vehicle to fly; give --connect URL"),
        (["--vehicle", "2", "--connect", URL, "--connect", URL], "--connect is given 2 times"),
        (["--vehicle", "1", "--connect", URL, "--listen", GROUP], "--fleet-key FILE is missing"),
        (["--vehicle", "1", "--connect", URL, "--fleet-key", ""], "--fleet-key is empty"),
        (["--vehicle", "1", "--connect", URL, "--peer", "drone"], "--peer drone: write tcp/"),
        (["--vehicle", "1", "--connect", URL, "--strategy", "rdfs"], "strategy = 'rdfs'"),
        (["--vehicle", "1", "--connect", URL, "--camera", "x", "--camera", "y"], "--camera is"),
    ],
)
def test_wrong_arguments_are_named_in_a_line(arguments, words, field, monkeypatch, refused):
    monkeypatch.delenv("UAVMAP_FLEET_KEY_FILE", raising=False)
    keyed = ["--fleet-key", str(field.with_name("fleet.key"))] if "--peer" in arguments else []
    out = field.with_name("out")
    assert words in refused("onboard", field, *arguments, *keyed, "--out", out)
    assert not out.exists()


def test_help_names_the_strategies_of_a_fleet(capsys):
    with pytest.raises(SystemExit):
        main(["onboard", "--help"])
    told = " ".join(capsys.readouterr().out.split())
    assert "the strategy, instead of the mission file's: swath, survey --speedup" in told
    assert "--sim" not in told


def test_flight_without_a_fleet_has_no_network(tmp_path, refused):
    from tests.unit.uavmap.output.test_merging import ALONE, plan, written  # noqa: PLC0415

    folder = written(tmp_path / "flight", plan(ALONE, None), [])
    line = refused("resume", folder, "--listen", GROUP)
    assert "go with a flight that `uavmap onboard` began" in line


def test_fleet_on_the_ground_is_joined_by_its_endpoints(tmp_path, refused):
    listen, out = ("--listen", "tcp/127.0.0.1:7447"), ("--out", tmp_path / "a")
    assert "--listen, --peer or --router" in refused("fly", "burn", "--fleet", *out)
    assert "need --fleet" in refused("fly", "burn", "--sim", *listen, *out)
    assert "--fleet-key FILE is missing" in refused("fly", "burn", "--fleet", *listen, *out)
    assert not (tmp_path / "a").exists()
