"""The page on reliability, and the records of which it is made."""

from __future__ import annotations

from collections import Counter

import pytest

from tests import coverage, reliability
from tests.campaign.outcome import FORBIDDEN, Outcome
from tests.campaign.record import keep, kept, run_of

STORM = Outcome(
    7, "storm", "--seed 7: storm (search)", frozenset({"inc", "far", "near"}),
    (("far", "12.0 s: 200 m"), ("far", "13.0 s: 220 m"), ("near", "14.0 s: 1 m")),
    Counter({"falling": 2}),
)  # fmt: skip
GOOD = Outcome(8, "pairs", "--seed 8", frozenset({"ok"}), ())


def test_page_is_made_of_the_records_as_they_are():
    text = reliability.PAGE.read_text("utf-8")
    assert text == reliability.page(kept()), "python -m tests.reliability writes it anew"


def test_page_has_a_promise_for_each_forbidden_outcome():
    assert set(reliability.PROMISES) == set(FORBIDDEN.values())


@pytest.mark.parametrize(
    ("violations", "flights", "bound"),
    [(0, 3000, 3 / 3000), (0, 1, 0.95), (1, 1000, 4.744 / 1000), (5, 5, 1.0), (0, 0, 1.0)],
)
def test_upper_bound_is_three_in_n_where_nothing_happened(violations, flights, bound):
    assert reliability.upper_bound(violations, flights) == pytest.approx(bound, rel=2e-3)


def test_record_is_read_as_it_was_kept_and_replaces_the_same_seeds(tmp_path):
    path = tmp_path / "flights.json"
    first = run_of("abc", "sitl", "--pilots", 7, [STORM])
    second = run_of("abc", "sitl", "--pilots", 7, [STORM, GOOD])
    other = run_of("abc", "reducer", "", 7, [GOOD])
    for run in (first, other, second):
        keep(run, path)
    assert kept(path) == [other, second]
    assert kept(tmp_path / "none.json") == []


def test_a_flight_that_breaks_a_promise_twice_counts_once():
    text = reliability.promises([run_of("abc", "reducer", "", 7, [STORM, GOOD])])
    rows = {line.split(" | ")[0].strip("| "): line.split(" | ")[1] for line in text.splitlines()}
    assert rows[reliability.PROMISES["far"]].startswith("1 (< 97.5%)")
    assert rows[reliability.PROMISES["near"]].startswith("1 ")
    assert rows[reliability.PROMISES["lie"]].startswith("0 (< 77.6%)")


def test_coverage_of_a_part_sums_its_files_and_names_branches_not_taken():
    totals = {"covered_lines": 8, "num_statements": 10, "covered_branches": 3, "num_branches": 4}
    files = {
        "a/one.py": {"summary": totals, "missing_branches": [[12, 14]]},
        "a/two.py": {"summary": totals, "missing_branches": []},
        "b/one.py": {"summary": totals, "missing_branches": [[1, 2]]},
    }
    found = coverage.summed(files, "a/")
    assert found == {"lines": 0.8, "branches": 0.75, "missing": ["one.py:12"]}
