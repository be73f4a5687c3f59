"""The pages on real autopilots: the findings name tests that exist, the table is the last one."""

import re
from pathlib import Path

from tests.prose import texts
from tests.real.figures import kept, written

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "real-autopilots.md"
FINDINGS = (ROOT / "docs" / "reference" / "real-findings.md").read_text("utf-8")
_TEST = re.compile(r"`(test_\w+)`")


def test_every_test_that_the_findings_name_exists():
    named = set(_TEST.findall(FINDINGS))
    there = {
        name
        for path in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(r"def (test_\w+)", path.read_text("utf-8"))
    }
    assert len(named) > 30
    assert named - there == set()


def test_every_finding_names_its_test():
    lines = FINDINGS.splitlines()
    points = [text for line, text in texts(FINDINGS) if lines[line - 1].startswith("* ")]
    assert len(points) > 30
    assert [text for text in points if not _TEST.search(text)] == []


def test_the_table_of_real_flights_shows_the_last_figures():
    page = PAGE.read_text("utf-8")
    assert page == written(page, kept()), "python -m tests.real.figures writes it anew"
