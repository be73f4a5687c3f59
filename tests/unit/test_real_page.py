"""The page on real autopilots names tests that exist."""

import re
from pathlib import Path

from tests.real.figures import kept, written

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "real-autopilots.md"


def test_every_test_that_the_page_names_exists():
    named = set(re.findall(r"`(test_\w+)`", PAGE.read_text("utf-8")))
    there = {
        name
        for path in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(r"def (test_\w+)", path.read_text("utf-8"))
    }
    assert len(named) > 30
    assert named - there == set()


def test_every_row_says_what_happens_now():
    """A row without a test says openly that it is not as it should be."""
    rows = [
        [cell.strip() for cell in line.strip().strip("|").split("|")]
        for line in PAGE.read_text("utf-8").splitlines()
        if line.startswith("|") and line.count("|") == 5
    ]
    rows = [row for row in rows if row[0] not in ("what was done", "---")]
    assert len(rows) > 30
    assert [row for row in rows if not row[3] and "**not yet**" not in row[2]] == []


def test_the_table_of_real_flights_shows_the_last_figures():
    page = PAGE.read_text("utf-8")
    assert page == written(page, kept()), "python -m tests.real.figures writes it anew"
