"""Missions over ground that is not flat: faults, warnings and estimates."""

from dataclasses import replace

import pytest

from missions.errors import MissionFileError
from missions.flight.airspace.needs import uncontrolled_air
from missions.flight.return_home import has_energy_for
from missions.flight.setting_of import setting_of
from missions.flight.vehicle_state import Phase, VehicleState
from missions.mission.flyable import farthest_corner, warnings
from missions.mission.height_and_speed import altitude_reason
from missions.mission.schema import parse_fields
from missions.mission.views import path_speed_m_s, seen_whole_m
from missions.orders import ReturnToLaunch
from missions.units import GridPoint
from tests.support.ground.hills import checked, hills, over, slope, text_over
from tests.support.small_missions import mission_text, square

BOX = square(-4, 10, 24, 16)
FENCE = square(-40, -40, 100, 110)


def text(**how):
    return mission_text(BOX, FENCE, altitude_m=14.0, **how)


def faults(content):
    with pytest.raises(MissionFileError) as error:
        checked(content)
    return str(error.value)


def test_mission_without_a_ground_section_is_as_before():
    made = checked(text())
    assert (made.ground, made.surveyed, made.relief, made.highest_ground_m) == (None,) * 3 + (0.0,)
    assert setting_of(made).relief_m == 0.0


def over_slope(percent, **how):
    return text_over(text(), slope(percent, 0.0), **how)


REFUSED = {
    "the height of the ground is missing": (
        text().replace("[flight]", '[flight]\nheight_above = "ground"'),
        'flight.height_above = "ground": the height of the ground is unknown',
    ),
    "a damaged lattice": (over_slope(5.0).replace('heights = "e', 'heights = "f'), "terrain.dem"),
    "steep ground": (over_slope(70.0), "rises by 70% near 48.0", "up to 60% is followed"),
    "a ceiling is above the start, layers above the ground": (
        over_slope(20.0).replace("[fence]", "[fence]\nceiling_m = 25.0"),
        "above ground that rises 14.4 m above the start, above fence.ceiling_m = 25",
    ),
    "level flight into a hill": (
        over_slope(20.0, above="home"),
        "rises to 14.4 m above the start", 'set flight.height_above = "ground"',
    ),
    "heights that were kept for another fence": (
        text_over(mission_text(BOX, square(-40, -40, 100, 400), altitude_m=14.0), slope(5.0, 0.0)),
        "terrain.dem: its heights do not reach over 12000 m2 of fence.polygon",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_ground_that_cannot_be_followed_is_refused(what):
    content, *messages = REFUSED[what]
    line = faults(content)
    assert all(part in line for part in messages)


def test_a_geotiff_is_not_read_without_its_mission_file():
    with pytest.raises(MissionFileError, match=r"terrain.dem = 'dem.tif': a GeoTIFF"):
        parse_fields(text() + '\n[terrain]\ndem = "dem.tif"', "x.toml")


def test_level_flight_over_lower_ground_is_warned_of_with_its_cost():
    made = checked(text_over(text(), slope(14.0, 180.0), above="home"))
    reported = warnings(made, setting_of(made).grid)
    assert any("-10.1 to +5.6 m" in line and "off by up to 6.1 m" in line for line in reported), (
        reported
    )
    assert made.ground is None


def test_layers_over_a_slope_lie_farther_apart():
    sloped = text_over(text(vehicles=2, layer_m=5.2), slope(30.0, 0.0))
    messages = faults(sloped)
    assert "above a slope of 30% layers must lie 5.2 m apart" in messages
    assert "raise it to 5.3" in messages
    checked(text_over(text(vehicles=2, layer_m=5.3), slope(30.0, 0.0)))


def test_pictures_show_less_uphill_and_paths_climb_no_faster_than_autopilots():
    flat = checked(text(strategy="swath"))
    sloped = over(flat, slope(30.0, 0.0))
    east_m, north_m = seen_whole_m(flat, 14.0, east_ahead=True)
    less_east_m, less_north_m = seen_whole_m(sloped, 14.0, east_ahead=True)
    assert less_east_m < east_m
    assert less_north_m < north_m
    assert path_speed_m_s(sloped, 14.0) == pytest.approx(min(1.2 / 0.3, path_speed_m_s(flat, 14.0)))


def test_climbs_on_the_way_are_paid_for():
    made = checked(text())
    flat, sloped = setting_of(made), setting_of(over(made, hills(2, 60.0)))
    corner = farthest_corner(made, flat.grid)
    assert farthest_corner(sloped.mission, flat.grid).sortie_wh > corner.sortie_wh
    far = GridPoint(40.0, 50.0)
    vehicle = VehicleState(1, 14.0, phase=Phase.AIRBORNE, height_m=14.0, landed=False)
    need_wh = next(
        wh / 100.0 for wh in range(2500)
        if has_energy_for(flat, _with(vehicle, wh / 100.0), far, hover_s=0.0)
    )  # fmt: skip
    assert not has_energy_for(sloped, _with(vehicle, need_wh), far, hover_s=0.0)
    way_m = sloped.ups_and_downs_m([vehicle.position, far, vehicle.position])
    more_wh = sloped.energy.relief_wh(way_m) + 0.02
    assert has_energy_for(sloped, _with(vehicle, need_wh + more_wh), far, hover_s=0.0)


def _with(vehicle, remaining_wh):
    return replace(vehicle, remaining_wh=remaining_wh)


def test_layers_by_themselves_keep_below_the_ceiling_over_the_highest_ground():
    content = text().replace("altitude_m = 14.0", 'altitude_m = "auto"')
    assert 'altitude_m = "auto"' in content
    sloped = text_over(content, slope(20.0, 0.0)).replace("[fence]", "[fence]\nceiling_m = 30.0")
    made = checked(sloped)
    assert made.altitude_m(0) == 15.6
    assert altitude_reason(made) == "fence.ceiling_m"
    low = sloped.replace("ceiling_m = 30.0", "ceiling_m = 16.0")
    assert "1.6 m above ground that rises 14.4 m above the start" in faults(low)


def test_height_of_a_return_over_the_highest_ground_counts_from_the_lowest():
    made = over(checked(text(vehicles=2)), slope(40.0, 0.0))
    high = made.model_copy(update={"flight": made.flight.model_copy(update={"altitude_m": 50.0})})
    setting = setting_of(high)
    assert setting.relief_m == pytest.approx(46.4, abs=2.5)
    returning = VehicleState(
        1, 50.0, phase=Phase.GUARDED, height_m=50.0, landed=False, order=ReturnToLaunch()
    )
    way, column, _ = uncontrolled_air(setting.initial_state(), returning)
    assert min(way.high_m, column.high_m) >= 50.0 + setting.relief_m


def test_air_of_a_return_by_the_autopilot_reaches_up_to_its_return_height():
    state = setting_of(checked(text(vehicles=2))).initial_state()
    returning = VehicleState(
        1, 14.0, phase=Phase.GUARDED, height_m=14.0, landed=False, order=ReturnToLaunch()
    )
    assert [air.high_m for air in uncontrolled_air(state, returning)] == [30.0, 30.0, 30.0]


def test_camera_that_is_too_narrow_uphill_is_refused_with_one_that_is_not():
    sloped = text_over(text().replace("altitude_m = 14.0", "altitude_m = 11.5"), slope(45.0, 0.0))
    messages = faults(sloped)
    assert "uphill on 45%" in messages
    wider = messages.partition("use a camera of hfov_deg ")[2].split(",")[0]
    now = messages.partition("camera.hfov_deg = ")[2].split(":")[0]
    assert float(wider) > float(now)
    checked(sloped.replace("[camera]", f"[camera]\nhfov_deg = {wider}"))
