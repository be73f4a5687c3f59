"""Tables of classes: valid and invalid entries."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from missions.classes import Classes
from missions.mission.sections import DetectorSection


@pytest.mark.parametrize(
    ("table", "why"),
    [
        ({}, "no class; add one"),
        ({"region": ["oil"]}, "no class; add one"),
        ({"oil": {"number": 1}, "weed": {"number": 1}}, "two classes have the same number"),
        ({"oil": {"number": 1}, "region": ["weed"]}, "region names 'weed', which is no class"),
        ({"oil": {"number": 0}}, "greater than or equal to 1"),
        ({"oil": {"number": 255}}, "less than or equal to 254"),
        ({"oil": {"number": 1, "thickness_um": [5.0, 0.3]}}, "the least comes first"),
        ({"oil": {"number": 1, "thickness_um": [1.0, 2.0, 3.0]}}, "at most 2"),
        ({"oil": {"number": 1, "color": 3}}, "not permitted"),
    ],
)
def test_invalid_table_of_classes_is_refused(table: dict[str, Any], why: str) -> None:
    with pytest.raises(ValidationError, match=why):
        Classes.model_validate(table)


def test_section_with_classes_is_written_as_it_was_read() -> None:
    table = {
        "name": "color",
        "color": {"samples": {"oil": [[1, 2, 3]]}},
        "classes": {"oil": {"number": 5, "thickness_um": [200.0]}, "region": ["oil"]},
    }
    section = DetectorSection.model_validate(table)
    assert section.model_dump(mode="json", exclude_unset=True) == table
    assert section.explored == (5,)
    assert section.parameters["classes"] is section.classes
    assert DetectorSection().explored == ()
