"""Lines that the operator gets at once, beside those of `test_time_left`."""

from __future__ import annotations

import pytest

from tests.support.scenarios import scenario


@pytest.mark.parametrize(("intensity", "shown"), [(254, 1), (150, 0)])
def test_detector_that_finds_region_everywhere_is_reported_once(intensity, shown):
    def change(text: str) -> str:
        return text.replace("[detector]\n", f"[detector]\nintensity = {intensity}\n")

    flight = scenario("ardupilot", change=change)
    assert flight.said.count("check whether it fits this ground") == shown
