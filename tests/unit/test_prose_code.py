"""The check of code finds faults in docstrings, comments, names of tests, and nowhere else."""

from __future__ import annotations

import pytest

from tests import prose_code
from tests.prose import ROOT

PAGES = ROOT / "uavmap"


@pytest.mark.parametrize(
    "source",
    [
        '"""What a vehicle does."""\n',
        'def f():\n    """Whether it flies."""\n',
        'X = 1\n"""How long it waits, s."""\n',
        'def f():\n    """Return one.\n\n    The vehicle is told to land.\n    """\n',
        "x = 1  # nobody waits\n",
        "# a vehicle which is told\n# to land\nx = 1\n",
    ],
)
def test_faults_of_docstrings_and_comments_are_found(source):
    assert prose_code.source_faults(source)


@pytest.mark.parametrize(
    "source",
    [
        'def told(what):\n    """Return what a vehicle reports."""\n    return "who is told"\n',
        "import os  # noqa: nobody\n",
        'def f(told):\n    """Return one.\n\n    Args:\n        told: the report.\n    """\n',
        'def f():\n    """Return one.\n\n    >>> told("nobody")\n    1\n    """\n',
        '"""A list:\n\n    told = nobody\n\nIt ends.\n"""\n',
    ],
)
def test_code_and_pragmas_are_no_prose(source):
    assert prose_code.source_faults(source) == []


def test_fault_has_the_line_of_its_text_or_name():
    for line in ("y = 2  # it is told", "def test_who_waits(): ...", "def test_it_waits(): ..."):
        faults = prose_code.source_faults(f"def test_flight(): ...\n{line}\n")
        assert [fault.line for fault in faults] == [2]


def test_check_reads_product_and_tests_and_finds_no_fault_here():
    """`make check` reads all of these; a module, a page and a script are enough here."""
    assert len(prose_code.checked()) > 600
    page, script = (PAGES / name for name in ("photos/tune/paint.html", "ui/page/flight_view.js"))
    assert {page, script} <= set(prose_code.pages())
    assert prose_code.main([__file__, str(PAGES / "journal/flight_plan.py"), page, script]) == 0
