"""Names on pages exist: modules, paths, keys of a mission file, commands, links, figures."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import BaseModel

from missions.flight.vehicle_state import Phase, ReturnReason
from missions.mission.schema import Mission, VehicleSection
from missions.mission.sim_section import SimFault
from sitl.testing import Vehicle
from uavmap.ui.cli import parser

ROOT = Path(__file__).parents[2]
FILES = ("tlog", "gif", "kml", "gpx")
"""Suffixes of file names that look like keys of a mission."""
ROOMS = ("missions", "vision", "sitl", "uavmap", "tests")
PAGES = [
    *sorted(ROOT.glob("*.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
_NAME = re.compile(r"[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+")


@pytest.fixture(params=PAGES, ids=lambda page: page.name)
def page(request: pytest.FixtureRequest) -> Path:
    assert isinstance(request.param, Path)
    return request.param


def prose(page: Path) -> str:
    """Return a page without its blocks of code."""
    return re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL)


def quoted(page: Path) -> list[str]:
    return re.findall(r"`([^`\n]+)`", prose(page))


def attribute_of(owner: object, names: list[str]) -> bool:
    for name in names:
        fields = getattr(owner, "__dataclass_fields__", {})
        if not hasattr(owner, name) and name not in fields:
            return False
        owner = getattr(owner, name, None)
    return True


def exists(dotted: str) -> bool:
    """Return whether a module, or an object in a module, has this name."""
    parts = dotted.split(".")
    for count in range(len(parts), 0, -1):
        path = ROOT.joinpath(*parts[:count])
        if path.with_suffix(".py").exists() or (path / "__init__.py").exists():
            names = parts[count:]
            return not names or attribute_of(
                importlib.import_module(".".join(parts[:count])), names
            )
    return False


def test_every_module_that_a_page_names_exists(page):
    missing = []
    for text in quoted(page):
        name = text.partition("(")[0]
        if not _NAME.fullmatch(name) or name.split(".")[0] not in ROOMS:
            continue
        fixture = name.startswith("sitl.") and hasattr(Vehicle, name.split(".")[1])
        if not fixture and not exists(name):
            missing.append(name)
    assert not missing, f"{page.name} has an unknown name"


def test_every_path_that_a_page_names_exists(page):
    paths = [
        text for text in quoted(page) if re.fullmatch(rf"(?:{'|'.join(ROOMS)}|docs)/[\w./-]*", text)
    ]
    assert [text for text in paths if not (ROOT / text).exists()] == []


def anchor(title: str) -> str:
    """Return the anchor of a title, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", title.strip().lower()).replace(" ", "-")


def test_every_link_leads_somewhere(page):
    missing = []
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if target.startswith(("http://", "https://")):
            continue
        path, _, title = target.partition("#")
        there = (page.parent / path) if path else page
        if not there.exists():
            missing.append(target)
        elif title:
            titles = re.findall(r"^#+ (.+)$", there.read_text("utf-8"), re.MULTILINE)
            if title not in map(anchor, titles):
                missing.append(target)
    assert not missing


def sections() -> Iterator[tuple[str, type[BaseModel]]]:
    for name, field in Mission.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield name, field.annotation
    yield "vehicles", VehicleSection
    yield "sim.faults", SimFault


def test_every_key_of_a_mission_that_a_page_names_exists(page):
    known = dict(sections())
    missing = []
    for text in quoted(page):
        section, _, key = text.partition(" ")[0].rpartition(".")
        if section in known and section not in ROOMS and key not in FILES and key not in (
            known[section].model_fields
        ):  # fmt: skip
            missing.append(text)
    assert not missing


EXTERNAL = {
    "dask", "git", "journalctl", "jq", "jupyter", "kill", "openssl", "pip", "pipx", "rpicam-hello",
    "ssh", "sudo", "uv",
}  # fmt: skip
"""Programs of others that pages call."""


def commands(page: Path) -> Iterator[list[str]]:
    """Yield every command of the blocks of a page, in words."""
    text = re.sub(r"\\\n\s*", "", page.read_text("utf-8"))
    for block in re.findall(r"^ *```sh\n(.*?)^ *```", text, re.DOTALL | re.MULTILINE):
        for line in block.splitlines():
            if words := shlex.split(line, comments=True):
                yield words


def command_lines(page: Path) -> Iterator[str]:
    """Return every command `uavmap ...` of the blocks of a page."""
    return (shlex.join(words) for words in commands(page) if words[0] == "uavmap")


def subcommands() -> dict[str, set[str]]:
    """Return the commands of uavmap, each with its options."""
    (choices,) = (
        action.choices for action in parser()._actions if isinstance(action.choices, dict)
    )
    return {
        name: {option for action in one._actions for option in action.option_strings}
        for name, one in choices.items()
    }


def test_the_command_lines_of_a_page_are_understood(page, capsys):
    for line in command_lines(page):
        try:
            parser().parse_args(shlex.split(line)[1:])
        except SystemExit:
            pytest.fail(f"{line}: {capsys.readouterr().err}")


def test_every_command_of_a_page_is_known(page):
    """Every command is a target of make, a module of Python, an extra, or a program of others."""
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    for words in commands(page):
        program = words[0].rpartition("/")[2]
        if program == "make":
            assert {word for word in words[1:] if "=" not in word} <= targets
        elif program in ("python", "python3"):
            assert words[1] != "-m" or exists(words[2])
        else:
            assert program in {*EXTERNAL, "uavmap"}, shlex.join(words)
        for extras in re.findall(r"\.\[([\w,]+)\]", shlex.join(words)):
            assert set(extras.split(",")) <= project["optional-dependencies"].keys()


def test_every_command_in_the_text_of_a_page_is_known(page):
    """`uavmap fly --sim` in a sentence has a known command and options; `python -m` a module."""
    known = subcommands()
    for text in quoted(page):
        program, _, rest = text.partition(" ")
        words = re.sub(r"[<>].*", "", rest).split()
        if program == "uavmap" and words and words[0].islower() and words[0].isalpha():
            assert words[0] in known, text
            options = {word.partition("=")[0] for word in words[1:] if word.startswith("--")}
            assert options <= known[words[0]], text
        if program == "python" and words[:1] == ["-m"] and words[1].startswith(ROOMS):
            assert exists(words[1]), text


def test_the_readme_has_command_lines():
    assert len(list(command_lines(ROOT / "README.md"))) > 5


# --- the floors of the rooms ----------------------------------------------------------------------
def floors(room: str) -> list[set[str]]:
    """Return the floors of a room as import-linter holds them, from top to bottom."""
    text = (ROOT / "pyproject.toml").read_text("utf-8")
    for contract in tomllib.loads(text)["tool"]["importlinter"]["contracts"]:
        layers = contract.get("layers", [""])
        if layers[0].startswith(f"{room}."):
            return [set(layer.split(" | ")) for layer in layers]
    raise AssertionError(f"{room} has no floors")


@pytest.mark.parametrize("room", ["missions", "uavmap", "sitl"])
def test_the_architecture_has_the_floors_that_are_held(room):
    text = (ROOT / "docs" / "explanation" / "architecture.md").read_text("utf-8")
    table = re.search(rf"^\| `{room}`[^|]* \| \|\n\|---.*\n((?:\|.*\n)+)", text, re.MULTILINE)
    assert table is not None
    rows = [set(re.findall(r"`([\w.]+)`", row.split("|")[1])) for row in table[1].splitlines()]
    assert rows == floors(room)


# --- the glossary and the page on safety --------------------------------------------------------
def defined() -> set[str]:
    """Return the terms of the glossary."""
    text = (ROOT / "docs" / "glossary.md").read_text("utf-8")
    cells = re.findall(r"^\| ([^|]+) \| [^|]+ \|$", text, re.MULTILINE)
    return {term.strip(" `*") for cell in cells for term in cell.split(",")}


@pytest.mark.parametrize("word", [*Phase, *ReturnReason])
def test_the_glossary_has_every_phase_and_every_return_reason(word):
    assert word in defined()


FIGURES = re.findall(
    r"^\| [^|]+ \| ([^|]+) \| `([\w.]+)` \|$",
    (ROOT / "docs" / "reference" / "thresholds.md").read_text("utf-8"),
    re.MULTILINE,
)


def test_the_page_on_safety_has_figures():
    assert len(FIGURES) > 20


@pytest.mark.parametrize(("figure", "name"), FIGURES, ids=[name for _, name in FIGURES])
def test_the_figures_of_the_page_on_safety_are_those_of_the_code(figure, name):
    module, _, constant = name.rpartition(".")
    value = getattr(importlib.import_module(module), constant)
    number = re.match(r"[\d.]+", figure.strip())
    assert number is not None
    unit = figure.strip()[number.end() :].strip()
    assert float(number[0]) == value * (100 if unit == "%" else 1)


def defined_in(module: str) -> set[str]:
    """Return the names that a module, or a module of a package, assigns at its top level."""
    path = ROOT.joinpath(*module.split("."))
    files = sorted(path.glob("*.py")) if path.is_dir() else [path.with_suffix(".py")]
    return {
        target.id
        for file in files
        for node in ast.parse(file.read_text("utf-8")).body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name)
    }


def test_the_figures_are_constants():
    """A page cannot state a figure that the program changes while it runs."""
    for _, name in FIGURES:
        module, _, constant = name.rpartition(".")
        assert constant in defined_in(module), f"{name} is imported there, not defined"
