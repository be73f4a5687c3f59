"""The list of slow tests names tests that exist."""

from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from tests.conftest import SLOW

TESTS = Path(__file__).parents[1]


@pytest.mark.parametrize("line", SLOW)
def test_slow_list_line_names_existing_tests(line):
    name, _, pattern = line.partition("::")
    sources = [path.read_text("utf-8") for path in TESTS.rglob(name)]
    defined = [
        line.split("def ")[1].split("(")[0]
        for source in sources
        for line in source.splitlines()
        if line.lstrip().startswith(("def test_", "async def test_"))
    ]
    assert any(fnmatchcase(test, pattern.split("[")[0] + "*") for test in defined)
