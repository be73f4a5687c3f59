"""The check of names finds those that the style excludes, and leaves fields and locals alone."""

from __future__ import annotations

import pytest

from tests import prose_names


@pytest.mark.parametrize(
    "source",
    [
        "def take(x): ...\n",
        "class A:\n    @classmethod\n    def of(cls): ...\n",
        "class A:\n    async def _tell_places(self): ...\n",
        "class Looked: ...\n",
        "class ToldPose: ...\n",
        "TELL_EVERY_S: Final = 1.0\n",
        "if X:\n    def who_flies(): ...\n",
        "_MOST_BYTES: Final = 100\n",
        "class A:\n    async def _connected(self) -> None: ...\n",
    ],
)
def test_names_of_functions_classes_and_constants_excluded_words_are_found(source):
    assert prose_names.name_faults(source)


@pytest.mark.parametrize(
    "source",
    [
        "def take_off(): ...\n",
        "def centre_of(cell):\n    told = 1\n    return told\n",
        "class A:\n    camera_tells_pose: bool\n",
        "class FrameSeen: ...\n",
        "essays, whole = 1, 2\n",
        "ALMOST_S: Final = 1.0\n",
        "def feed(x) -> None: ...\n",
        "def moved(x) -> Point: ...\n",
    ],
)
def test_names_of_fields_and_locals_and_longer_words_pass(source):
    assert prose_names.name_faults(source) == []


def test_names_of_checked_modules_are_without_a_fault():
    found = [
        (path.name, fault)
        for path in prose_names.checked()
        for fault in prose_names.name_faults(path.read_text("utf-8"))
    ]
    assert found == []
