"""The page on height and speed: its picture is that of the code, its figures are the defaults."""

import re
from pathlib import Path

import pytest

from missions.mission.schema import CameraSection, Fence
from tests.benchmarks.planning.height_and_speed_picture import picture

DOCS = Path(__file__).parents[2] / "docs"


def test_picture_of_the_page_is_the_one_that_the_program_draws():
    assert (DOCS / "images" / "height-and-speed.svg").read_text("utf-8") == picture()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("camera.pixels_per_cell", CameraSection().pixels_per_cell),
        ("fence.ceiling_m", Fence.model_fields["ceiling_m"].default),
    ],
)
def test_the_defaults_of_the_page_are_those_of_the_code(key, value):
    text = (DOCS / "explanation" / "height-and-speed.md").read_text("utf-8")
    row = re.search(rf"^\| `{key}` \| ([0-9.]+) \|", text, re.MULTILINE)
    assert row is not None
    assert float(row[1]) == value
