"""The plan of a mission as a page of its own: it loads nothing and runs nothing."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence

from uavmap.preflight.plan_scene import Mark, Scene
from uavmap.results.legend import nice_length_m
from uavmap.results.palette import Colour

_STYLE = """\
body { font: 15px/1.45 system-ui, sans-serif; color: #23272b; margin: 1.5rem; }
h1 { font-size: 1.5rem; margin: 0 0 1rem; }
main { display: flex; flex-wrap: wrap; gap: 1.5rem; align-items: flex-start; }
svg { border: 1px solid #787e84; background: #f7f7f3; max-width: 100%; height: auto; }
table { border-collapse: collapse; }
th { text-align: left; font-weight: normal; color: #5a6066; padding: .15rem 1rem .15rem 0;
  vertical-align: top; white-space: nowrap; }
td { padding: .15rem 0; max-width: 26rem; }
ul { list-style: none; padding: 0; margin: 0 0 1rem; }
li { display: flex; align-items: center; gap: .6rem; }
.warning { color: #8a1c2c; max-width: 34rem; }
"""


def plan_page(scene: Scene, facts: Sequence[tuple[str, str]], warnings: Sequence[str]) -> str:
    """The page, in HTML with a drawing in SVG. Names from the mission are escaped."""
    title = f"Plan of {html.escape(scene.title)}"
    rows = "\n".join(
        f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
        for name, value in facts
    )
    said = "\n".join(f'<p class="warning">{html.escape(line)}</p>' for line in warnings)
    legend = "\n".join(
        f"<li>{_sample(shape, colour, size)}{html.escape(text)}</li>"
        for shape, colour, text, size in scene.legend
    )
    drawing = "\n".join([*map(_Pen(scene).draw, scene.marks), *_scale_and_north(scene)])
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
<svg xmlns="http://www.w3.org/2000/svg" width="{scene.width_px}" height="{scene.height_px}"
 viewBox="0 0 {scene.width_px} {scene.height_px}" role="img" aria-label="{title}">
{drawing}
</svg>
<div>
<ul>
{legend}
</ul>
<table>
{rows}
</table>
{said}
</div>
</main>
</body>
</html>
"""


def _css(colour: Colour) -> str:
    return "#" + "".join(f"{channel:02x}" for channel in colour)


class _Pen:
    """Marks as SVG."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    def draw(self, mark: Mark) -> str:
        """An element."""
        points = [self._scene.pixel(point) for point in mark.points]
        listed = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        colour, width = _css(mark.colour), f"{abs(mark.width_px):g}"
        if mark.shape == "area":
            return f'<polygon points="{listed}" fill="{colour}"/>'
        if mark.shape == "line":
            return (
                f'<polyline points="{listed}" fill="none" stroke="{colour}" '
                f'stroke-width="{width}" stroke-linecap="round"/>'
            )
        if mark.shape == "dashes":
            return (
                f'<polygon points="{listed}" fill="none" stroke="{colour}" '
                f'stroke-width="{width}" stroke-dasharray="6 6"/>'
            )
        ((x, y),) = points
        words = html.escape(mark.words)
        if mark.shape == "dot":
            dot = (
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{width}" fill="{colour}" stroke="#fff" '
                'stroke-width="1.5"/>'
            )
            return dot + (_text(x, y + 3.5, words, "#fff", 10) if words else "")
        if mark.width_px < 0:
            return _text(x + mark.width_px, y + 5.0, words, colour, 14)
        return _text(x, y + mark.width_px + 5.0, words, colour, 14)


def _text(x: float, y: float, words: str, colour: str, size: int) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle" font-size="{size}" '
        f'font-family="system-ui, sans-serif" fill="{colour}">{words}</text>'
    )


def _sample(shape: str, colour: Colour, size: float) -> str:
    """A piece of the legend."""
    css = _css(colour)
    inside = {
        "square": f'<rect x="6" y="2" width="18" height="14" fill="{css}" stroke="#787e84"/>',
        "line": f'<path d="M0 9H30" stroke="{css}" stroke-width="{size:g}"/>',
        "dashes": f'<path d="M0 9H30" stroke="{css}" stroke-width="2" stroke-dasharray="6 6"/>',
        "dot": f'<circle cx="15" cy="9" r="6" fill="{css}"/>',
    }[shape]
    return f'<svg width="30" height="18" style="border:0;background:none">{inside}</svg>'


def _scale_and_north(scene: Scene) -> Iterator[str]:
    """A bar of a round length, lower left, and an arrow, upper right."""
    length_m = nice_length_m(180.0 / scene.px_per_m)
    length_px, y = length_m * scene.px_per_m, scene.height_px - 16.0
    yield (
        f'<path d="M16 {y - 6:.1f}V{y:.1f}H{16 + length_px:.1f}V{y - 6:.1f}" fill="none" '
        'stroke="#23272b" stroke-width="2"/>'
    )
    yield _text(16 + length_px / 2.0, y - 5.0, f"{length_m:g} m", "#23272b", 13)
    x = scene.width_px - 26.0
    yield f'<path d="M{x:.1f} 14L{x - 8:.1f} 50L{x:.1f} 42L{x + 8:.1f} 50Z" fill="#23272b"/>'
    yield _text(x, 66.0, "grid N", "#23272b", 12)
