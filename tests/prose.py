"""Check the prose of the project: words, sentences, lines and lengths of pages.

    python -m tests.prose                 every page that is checked
    python -m tests.prose docs/index.md   these pages

`faults` checks one text, such as a paragraph, a docstring or a comment. `page_faults` checks one
page of Markdown. `make check` runs this; each fault is a line with file, line, text and remedy.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[1]
MAX_WORDS_OF_A_SENTENCE: Final = 25
MAX_WORDS_OF_A_PAGE: Final = 1500
"""Words of a page that is neither generated nor a decision."""
MAX_WORDS_OF_ALL_PAGES: Final = 40_000
"""Words of all pages but reference and decisions."""
MAX_WORDS_OF_README: Final = 900
MAX_LINES_OF_README: Final = 120
MAX_CHARACTERS_OF_A_LINE: Final = 120
HIGHEST_GRADE: Final = 9.0
"""Flesch-Kincaid grade of README, tutorials and how-to guides."""

_PATTERNS: Final[Mapping[str, str]] = {
    r"^(?:Who|What|Nobody|That)\b(?!.*\?$)": "begin with the subject",
    r"^Of (?:a|an|the|what|who)\b": "begin with the subject",
    r"(?i:^so (?:long|much|far|often|many)\b)": "state maximum, minimum or default, with its unit",
    r"^\.\.\.\s?\w": "state the whole: each text stands by itself",
    r", too[.;:)]|, too$": "write also",
    r"(?i:\b(?:tells?|told|telling|says?|said|saying|hears?|heard|hearing)\b)": (
        "write send, report, receive, log or show"
    ),
    r"(?i:\b(?:nobody|everybody|somebody|anybody|everyone|someone|anyone)\b)": (
        "name the vehicle, the operator, the pilot, the program"
    ),
    r"(?i:\b(?:vehicle|aircraft|drone|autopilot|guardian|camera|computer|service)s? who\b)": (
        "a machine is which or that"
    ),
    r"(?i:\b(?:looked at|looks? from|looked from)\b)": "write observe, or frame",
    r"(?i:\bclaim(?:s|ed|ing)?\b|\bpromises? of air\b)": "write reserve, airspace reservation",
    r"(?i:\bways? home\b)": "write return path",
    r"(?i:\b(?:takes?|taken|took) up\b)": "write resume or reconnect",
    r"(?i:\bis ours\b|\bnot by us\b)": "write under our control, or by the pilot or a failsafe",
    r"(?i:\b(?:in vain|gone on|freed|laid|wishes|pressing)\b)": (
        "write stalled, progress, memory, projected, settings or urgent"
    ),
}
"""Patterns that are not written, each with its remedy."""
_COMPILED: Final = [(re.compile(pattern), remedy) for pattern, remedy in _PATTERNS.items()]
_END_OF_SENTENCE: Final = re.compile(r"(?<=[.!?])[)\"'*]*\s+(?=[(\"'*\[`]*(?:[A-Z0-9`]|uavmap\b))")
_ABBREVIATIONS: Final = re.compile(r"\b(e\.g|i\.e|etc|vs|cf|No|St|Dr)\.")


_MADE: Final = "<!-- made by:"
"""Mark of a page that a generator writes: its tables may have long lines."""
_MADE_PART: Final = re.compile(r"<!-- \w+ -->.*?<!-- end -->", re.DOTALL)
"""Part of a page that a generator writes; its words do not count."""


class Fault(NamedTuple):
    """One place where a page falls short."""

    line: int
    what: str


def plain(text: str) -> str:
    """Return a text without marks of Markdown; code is one word."""
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"``.+?``|`[^`]*`", "`code`", text)
    text = re.sub(r"<[^>]+>|\{[^}]*\}", " ", text)
    return re.sub(r"\*\*|(?<![\w*])\*(?=\w)|(?<=[\w.,:;?!)])\*(?![\w*])", "", text)


def sentences(text: str) -> list[str]:
    """Return the sentences of a text."""
    text = _ABBREVIATIONS.sub(r"\1", re.sub(r"\s+", " ", plain(text)).strip())
    return [part.strip() for part in _END_OF_SENTENCE.split(text) if part and part.strip()]


def words(text: str) -> list[str]:
    """Return the words of a text: what has a letter, code included."""
    return re.findall(r"[^\s|]*[^\W\d_][^\s|]*", plain(text))


def faults(text: str, longest: int | None = MAX_WORDS_OF_A_SENTENCE) -> list[str]:
    """Return what is wrong with the prose of one text.

    Args:
        text: a paragraph, a docstring, a comment or a message, without the code around it.
        longest: most words of a sentence; None for any number.
    """
    found = []
    for sentence in sentences(text):
        for pattern, remedy in _COMPILED:
            if match := pattern.search(sentence):
                found.append(f"{match[0].strip()!r} in {sentence[:60]!r}: {remedy}")
        if longest is not None and (count := len(words(sentence))) > longest:
            found.append(f"{count} words in {sentence[:60]!r}: at most {longest}")
    return found


# --- pages of Markdown ----------------------------------------------------------------------------
def texts(page: str) -> Iterator[tuple[int, str]]:
    """Yield the texts of a page with their lines: paragraphs, points of lists, cells of tables.

    Headings, code and comments are left out.
    """
    begun, gathered, code, comment = 0, list[str](), False, False
    for number, line in enumerate([*page.splitlines(), ""], 1):
        stripped = line.strip()
        fence = stripped.startswith(("```", "~~~"))
        comment = comment or stripped.startswith("<!--")
        point = re.match(r"(?:[*+-]|\d+\.)\s+", stripped)
        row = stripped.startswith("|")
        indented = line.startswith("    ") and not gathered
        if gathered and (not stripped or fence or point or row or stripped.startswith(("#", ">"))):
            yield begun, " ".join(gathered)
            gathered = []
        if (
            code
            or fence
            or comment
            or indented
            or not stripped
            or stripped.startswith(("#", ":::"))
        ):
            code = code != fence
            comment = comment and "-->" not in stripped
        elif row:
            for cell in re.split(r"(?<!\\)\|", stripped.strip("|")):
                if cell.strip(" :-"):
                    yield number, cell.strip()
        else:
            begun = begun if gathered else number
            gathered.append(stripped[point.end() :] if point else stripped.lstrip("> "))


def words_of(page: str) -> int:
    """Return how many words a page has, without code, headings and figures."""
    return sum(len(words(text)) for _, text in texts(page))


def grade(page: str) -> float:
    """Return the Flesch-Kincaid grade of the prose of a page; tables and code are left out."""
    prose = [
        sentence
        for number, text in texts(page)
        if not page.splitlines()[number - 1].strip().startswith("|")
        for sentence in sentences(text)
    ]
    spoken = [word for sentence in prose for word in words(sentence) if "`" not in word]
    if not prose or not spoken:
        return 0.0
    return (
        0.39 * len(spoken) / len(prose) + 11.8 * sum(map(_syllables, spoken)) / len(spoken) - 15.59
    )


def _syllables(word: str) -> int:
    word = re.sub(r"[^a-z]", "", word.lower())
    silent = word.endswith("e") and not word.endswith(("le", "ee"))
    silent = silent or (word.endswith("ed") and not word.endswith(("ted", "ded")))
    return max(1, len(re.findall(r"[aeiouy]+", word)) - silent)


def page_faults(path: Path) -> list[Fault]:
    """Return what is wrong with a page."""
    page, name = path.read_text("utf-8"), path.relative_to(ROOT).as_posix()
    made = _MADE in page
    found = [Fault(number, what) for number, text in texts(page) for what in faults(text)]
    for number, line in enumerate(page.splitlines(), 1):
        if len(line) > MAX_CHARACTERS_OF_A_LINE and not (made and line.startswith("|")):
            found.append(
                Fault(number, f"{len(line)} characters: at most {MAX_CHARACTERS_OF_A_LINE}")
            )
    most = MAX_WORDS_OF_README if name == "README.md" else MAX_WORDS_OF_A_PAGE
    long = made or name.startswith("docs/decisions/")
    own = _MADE_PART.sub("", page)
    if not long and (count := words_of(own)) > most:
        found.append(Fault(1, f"{count} words: at most {most}"))
    if name == "README.md" and (count := len(page.splitlines())) > MAX_LINES_OF_README:
        found.append(Fault(1, f"{count} lines: at most {MAX_LINES_OF_README}"))
    if (
        name.startswith(("README", "docs/tutorials/", "docs/how-to/"))
        and grade(page) > HIGHEST_GRADE
    ):
        found.append(Fault(1, f"reading grade {grade(page):.1f}: at most {HIGHEST_GRADE:g}"))
    return sorted(found)


def checked() -> list[Path]:
    """Return the pages that are checked."""
    return sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])


def words_of_all() -> int:
    """Return the words of all pages but reference and decisions."""
    pages = (path for path in (ROOT / "docs").rglob("*.md"))
    return sum(
        words_of(path.read_text("utf-8"))
        for path in pages
        if path.relative_to(ROOT / "docs").parts[0] not in ("reference", "decisions")
    )


def fault_lines(paths: Iterable[Path], faults_of: Callable[[Path], Iterable[Fault]]) -> list[str]:
    """Return a line for each fault of some files."""
    return [
        f"{path.relative_to(ROOT)}:{fault.line}: {fault.what}"
        for path in paths
        for fault in faults_of(path)
    ]


def main(names: Iterable[str]) -> int:
    """Print every fault; return 1 if there is one."""
    pages = [Path(name).resolve() for name in names] or checked()
    lines = fault_lines(pages, page_faults)
    if (count := words_of_all()) > MAX_WORDS_OF_ALL_PAGES:
        lines.append(f"docs: {count} words: at most {MAX_WORDS_OF_ALL_PAGES}")
    print("\n".join(lines) if lines else f"prose: {len(pages)} pages without a fault")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
