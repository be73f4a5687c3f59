"""The plan of a mission as a page of its own: it loads nothing and runs nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from markupsafe import Markup, escape

from uavmap.output.drawing import svg
from uavmap.output.drawing.scene import Scene

_STYLE: Final = """\
body { font: 15px/1.45 system-ui, sans-serif; color: #23272b; margin: 1.5rem; }
h1 { font-size: 1.5rem; margin: 0 0 1rem; }
main { display: flex; flex-wrap: wrap; gap: 1.5rem; align-items: flex-start; }
svg { max-width: 100%; height: auto; }
svg.sample { width: 30px; height: 18px; }
table { border-collapse: collapse; }
th { text-align: left; font-weight: normal; color: #5a6066; padding: .15rem 1rem .15rem 0;
  vertical-align: top; white-space: nowrap; }
td { padding: .15rem 0; max-width: 26rem; }
ul { list-style: none; padding: 0; margin: 0 0 1rem; }
li { display: flex; align-items: center; gap: .6rem; }
.warning { color: #8a1c2c; max-width: 34rem; }
"""


def plan_page(scene: Scene, facts: Sequence[tuple[str, str]], warnings: Sequence[str]) -> str:
    """Write the page, in HTML with a drawing in SVG. Names from the mission are escaped."""
    title = escape(scene.title)
    rows = Markup("\n").join(
        Markup("<tr><th>{}</th><td>{}</td></tr>").format(name, value) for name, value in facts
    )
    below = Markup("\n").join(Markup('<p class="warning">{}</p>').format(line) for line in warnings)
    legend = Markup("\n").join(
        Markup("<li>{}{}</li>").format(svg.sample(entry), entry.text) for entry in scene.legend
    )
    return f"""\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<title>{title}</title>
<style>
{_STYLE}</style>
</head>
<body>
<h1>{title}</h1>
<main>
{svg.map_drawing(scene)}
<div>
<ul>
{legend}
</ul>
<table>
{rows}
</table>
{below}
</div>
</main>
</body>
</html>
"""
