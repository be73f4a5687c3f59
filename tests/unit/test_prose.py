"""The check of the prose finds each kind of fault, and the pages are without a fault."""

from __future__ import annotations

import pytest

from tests import prose


@pytest.mark.parametrize(
    "text",
    [
        "Who is late flies on.",
        "What nobody sees.",
        "Of a path the next 8 s are reserved.",
        "So long a leg may last.",
        "... and so much longer.",
        "The vehicle lands, too.",
        "The service tells the vehicle to land.",
        "The vehicle was told.",
        "Everybody waits.",
        "A vehicle who waits lands.",
        "It looks from above.",
        "It claims the air.",
        "It plans its way home.",
        "It is taken up again.",
        "The vehicle is ours.",
        "It was tried in vain.",
        " ".join(["word"] * 26) + ".",
    ],
)
def test_faults_of_a_bad_sentence_are_found(text):
    assert prose.faults(text)


@pytest.mark.parametrize(
    "text",
    [
        "If the link is silent for 6 s, the service reports link loss.",
        "A pilot who takes control keeps it; a vehicle which waits holds.",
        "What can be read?",
        "Use `told`, `--say` and [a link](docs/told.md) as you like.",
        " ".join(["Word", *["word"] * 24]) + ". " + " ".join(["Word", *["word"] * 24]) + ".",
    ],
)
def test_faults_of_a_good_text_are_none(text):
    assert prose.faults(text) == []


def test_texts_of_a_page_have_no_code_and_no_headings():
    page = "# Who\n\nOne\ntwo.\n\n```sh\ntold\n```\n\n    told\n\n* Three.\n| four | `told` |\n"
    assert list(prose.texts(page)) == [
        (3, "One two."),
        (12, "Three."),
        (13, "four"),
        (13, "`told`"),
    ]
    assert prose.words_of(page) == 5


def test_grade_of_short_words_is_low_and_of_long_words_high():
    assert prose.grade("The cat sat on the mat.") < 3.0
    assert prose.grade("Heterogeneous configurability necessitates interdisciplinarity.") > 15.0


@pytest.mark.parametrize("page", prose.checked(), ids=lambda page: page.stem)
def test_page_has_no_fault(page):
    assert prose.page_faults(page) == []
