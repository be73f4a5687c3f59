"""The check of texts finds faults in strings that are shown, and leaves keys and code alone."""

from __future__ import annotations

import pytest

from tests import prose_texts

LONG = " ".join(["word"] * 20)


def faults(name, source):
    return [
        line for line, text in prose_texts.shown(name, source) for _ in prose_texts.faults(text)
    ]


@pytest.mark.parametrize(
    "source",
    [
        'raise ValueError("the vehicle and nobody else")',
        'print(f"vehicle {number:d} is told to land")',
        'log.info(f"who flies {vehicle}")',
        'f(f"{x}" if y else "its way home is blocked")',
        f'"""Return it."""\nTEXT = "{LONG} {LONG}"',
        'HELP = """\nThe vehicle\nis told to land.\n\n  told it is    code\n"""',
    ],
)
def test_faults_of_strings_in_python_are_found(source):
    assert len(faults("a.py", source)) == 1


@pytest.mark.parametrize(
    "source",
    [
        'KEY = {"told": 1, "patches_told": "nobody"}',
        '"""Nobody lands."""\nclass A:\n    """It is told to land."""',
        f'raise ValueError(f"{{path}}: key = {{value}}: {LONG}; {LONG}")',
        'HELP = "uavmap say it    it is told to land\\n  it is told to land"',
    ],
)
def test_keys_docstrings_and_examples_are_no_texts(source):
    assert faults("a.py", source) == []


def test_faults_of_a_script_have_their_lines():
    script = """const key = "told", url = `${told(it)}/said`;
// what is told to it
log(`vehicle ${number} is told to land`); log('it "said" no');
"""
    assert faults("a.js", script) == [2, 2, 3, 3]


def test_faults_of_a_page_have_their_lines_in_texts_labels_and_scripts():
    page = """<style>p.told { color: red; }</style>
<p>It <b>is told</b> to land.</p><p title="it is told">{{ told }} m</p>
<script>
const said = "it is told";
</script>
"""
    assert sorted(faults("a.html", page)) == [2, 2, 4]
