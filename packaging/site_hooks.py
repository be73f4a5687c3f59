"""Pages of the documentation site from outside the folder docs, which serve GitHub as well.

They are the guide for contributors, the changelog, and the notebooks of examples, each as a page.
Links to them are changed as they are read.
"""

from __future__ import annotations

import base64
import json
import logging
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
log = logging.getLogger("mkdocs.hooks.site")
PAGES = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
DECISIONS = "decisions/index.md"
ASIDE = ("LICENSE", "CITATION.cff")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add these pages."""
    for name, page in PAGES.items():
        text = (ROOT / name).read_text("utf-8")
        text = re.sub(r"\]\(docs/", "](", text)
        for other, its_page in PAGES.items():
            text = text.replace(f"]({other}", f"]({its_page}")
        files.append(File.generated(config, page, content=text))
    for name in ASIDE:
        files.append(File.generated(config, name, abs_src_path=str(ROOT / name)))
    for path in sorted((ROOT / "examples").glob("*.ipynb")):
        text, pictures = notebook_page(json.loads(path.read_text("utf-8")), path.stem)
        files.append(File.generated(config, f"examples/{path.stem}.md", content=text))
        for name, data in pictures.items():
            files.append(File.generated(config, f"examples/{name}", content=data))
    files.append(File.generated(config, DECISIONS, content=decisions_page()))
    return files


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add pages that the navigation does not name at its end, so that each can be reached."""
    named = set(re.findall(r"[\w./-]+\.md", json.dumps(config.nav)))
    docs = Path(config.docs_dir)
    pages = (path.relative_to(docs).as_posix() for path in sorted(docs.rglob("*.md")))
    rest = [page for page in pages if page not in named and not page.startswith("decisions/")]
    if rest and config.nav is not None:
        config.nav.append({"More": rest})
    return config


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Change links to the notebooks, and to the folder of decisions, to their pages."""
    markdown = markdown.replace("](decisions/)", f"]({DECISIONS})")
    return re.sub(r"\]\(\.\./\.\./examples/([\w-]+)\.ipynb\)", r"](../examples/\1.md)", markdown)


def decisions_page() -> str:
    """Return a list of the decisions, by number."""
    lines = ["# Decisions", "", "Reasons for things as they are, and the alternatives.", ""]
    for path in sorted((ROOT / "docs" / "decisions").glob("0*.md")):
        title = path.read_text("utf-8").partition("\n")[0].lstrip("# ")
        lines.append(f"* [{title}]({path.name})")
    return "\n".join(lines) + "\n"


# --- notebooks -----------------------------------------------------------------------------------
def notebook_page(notebook: dict[str, Any], name: str) -> tuple[str, dict[str, bytes]]:
    """Return a notebook as Markdown, and its pictures by the names of their files."""
    parts: list[str] = []
    pictures: dict[str, bytes] = {}
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source.replace("](../docs/", "](../"))
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            for text, data in outputs(output):
                if data is None:
                    parts.append(f"```text\n{text.rstrip()}\n```")
                else:
                    file = f"{name}-{len(pictures) + 1}.png"
                    pictures[file] = data
                    parts.append(f"![{text}]({file})")
    return "\n\n".join(parts) + "\n", pictures


def outputs(output: dict[str, Any]) -> Iterator[tuple[str, bytes | None]]:
    """Yield the output of a cell: a text, or a picture with the text in its place."""
    data = output.get("data", {})
    text = "".join(data.get("text/plain", output.get("text", "")))
    if "image/png" in data:
        yield "Output of the cell above", base64.b64decode("".join(data["image/png"]))
    elif text:
        yield text, None


# --- nothing from elsewhere ----------------------------------------------------------------------
_FETCHED = re.compile(
    r"<(?:script|img|iframe|source)\b[^>]*\bsrc=[\"']?(?:https?:)?//[^\"' >]+"
    r"|<link\b[^>]*\brel=[\"']?(?:stylesheet|preconnect|icon|preload)[^>]*"
    r"\bhref=[\"']?(?:https?:)?//[^>]+"
    r"|url\((?:https?:)?//[^)]+",
    re.IGNORECASE,
)


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Warn of a page that loads something from another host: a reader may be offline."""
    for found in _FETCHED.findall(output):
        log.warning("%s loads something from elsewhere: %s", page.file.src_uri, found)
    return output
