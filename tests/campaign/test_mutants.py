"""The table of seeded faults fits the program: each text is in its file, once."""

from __future__ import annotations

import pytest

from tests.campaign.mutants import ROOT, results, table

MUTANTS, FLIGHTS = table()


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_seeded_fault_text_is_in_its_file_once(mutant):
    assert (ROOT / mutant.file).read_text("utf-8").count(mutant.before) == 1
    assert mutant.before != mutant.after


def test_seeded_fault_has_flights_or_tests_that_look_for_it():
    for mutant in MUTANTS:
        assert mutant.flights or mutant.tests
        assert mutant.flights in {"", *FLIGHTS}
        assert all((ROOT / file).exists() for file in mutant.tests)


def test_results_are_of_faults_in_the_table():
    """The page shows those that were not found; each asks for a flight or a test that finds it."""
    assert set(results()) <= {mutant.name for mutant in MUTANTS}
