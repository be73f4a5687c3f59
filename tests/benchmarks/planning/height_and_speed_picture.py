"""The picture of the page on height and speed, as SVG, from the functions that flights use.

python -m tests.benchmarks.planning.height_and_speed_picture > docs/images/height-and-speed.svg
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from missions.mission.checks import parse_mission
from missions.mission.height_and_speed import speed_limits
from missions.mission.schema import Mission
from tests.benchmarks.svg import BLUE, GREEN, INK, PALE, RED, dot, drawing, label, line
from tests.support.plans import named_text

WIDTH, HEIGHT = 900, 340
HIGHEST_M = 40.0


class Chart:
    """A chart over the height: 0 to `HIGHEST_M` metres, and 0 to `most`."""

    def __init__(self, left: float, title: str, most: float, step: float) -> None:
        self.left, self.right, self.top, self.low = left, left + 240.0, 45.0, 285.0
        self.most = most
        self.parts = [label((self.left + self.right) / 2, 25, title)]
        for i in range(round(most / step) + 1):
            y = self.y(i * step)
            self.parts.append(line([(self.left, y), (self.right, y)], PALE, 1.0))
            self.parts.append(label(self.left - 6, y + 4, f"{i * step:g}", anchor="end"))
        for height_m in range(0, int(HIGHEST_M) + 1, 10):
            self.parts.append(label(self.x(height_m), self.low + 18, f"{height_m}"))
        self.parts.append(label((self.left + self.right) / 2, self.low + 38, "height, m"))

    def x(self, height_m: float) -> float:
        """Return pixels from the left."""
        return self.left + (self.right - self.left) * height_m / HIGHEST_M

    def y(self, value: float) -> float:
        """Return pixels from the top."""
        return self.low - (self.low - self.top) * value / self.most

    def curve(self, value: Callable[[float], float], colour: str) -> None:
        """Draw a function of the height, cut off at the edge of the chart."""
        points = []
        for tenths in range(10, int(HIGHEST_M * 10) + 1, 2):
            found = value(tenths / 10.0)
            if 0.0 < found <= self.most:
                points.append((self.x(tenths / 10.0), self.y(found)))
        self.parts.append(line(points, colour))

    def mark(
        self, height_m: float, value: float, text: str, colour: str, *, below: bool = False
    ) -> None:
        """Draw a point with its text to the right of it."""
        x, y = self.x(height_m), self.y(value)
        self.parts.append(dot(x, y, 4, colour))
        self.parts.append(label(x + 10, y + 14 * below - 4, text, anchor="start", colour=colour))


def side_view(mission: Mission, heights_m: Sequence[float]) -> list[str]:
    """Draw the view of a level camera from each height, from the side, over cells to scale."""
    scale, middle, ground = 6.4, 145.0, 285.0
    parts = [label(middle, 25, "what a picture shows (short side)")]
    cell_px = mission.grid.cell_m * scale
    for i in range(-5, 5):
        x = middle + (i + 0.5) * cell_px
        parts.append(
            f'<rect x="{x - cell_px / 2:.1f}" y="{ground:.1f}" width="{cell_px:.1f}" height="8" '
            f'fill="none" stroke="{INK}"/>'
        )
    parts.append(label(middle, ground + 38, f"cells of {mission.grid.cell_m:g} m"))
    optics = mission.camera.optics
    for height_m, colour in zip(heights_m, (BLUE, RED), strict=True):
        half_px = optics.footprint(height_m).short_m / 2.0 * scale
        top = ground - height_m * scale
        parts.append(
            line([(middle - half_px, ground), (middle, top), (middle + half_px, ground)], colour)
        )
        parts.append(label(middle, top + 38, f"{height_m:g} m", colour=colour))
    return parts


def picture() -> str:
    """Draw the whole picture, of the mission `runway`."""
    mission = parse_mission(named_text("runway").text, "runway")
    auto = mission.model_copy(
        update={"flight": mission.flight.model_copy(update={"altitude_m": "auto"})}
    )
    optics, cell_m = mission.camera.optics, mission.grid.cell_m
    given_m, auto_m = mission.altitude_m(0), auto.altitude_m(0)
    pixels = Chart(345.0, "pixels a cell", 200.0, 50.0)
    pixels.curve(lambda height_m: optics.pixels_per_cell(height_m, cell_m), INK)
    least = mission.camera.pixels_per_cell
    pixels.parts.append(
        line([(pixels.left, pixels.y(least)), (pixels.right, pixels.y(least))], GREEN, 1.5)
    )
    pixels.parts.append(
        label(pixels.left + 4, pixels.y(least) + 16, "needed", anchor="start", colour=GREEN)
    )
    for height_m, colour in ((given_m, BLUE), (auto_m, RED)):
        found = optics.pixels_per_cell(height_m, cell_m)
        pixels.mark(height_m, found, f"{found:.0f} from {height_m:g} m", colour)
    speeds = Chart(645.0, "fastest without stopping, m/s", 40.0, 10.0)
    speeds.curve(lambda height_m: speed_limits(mission, height_m).frames_m_s, INK)
    speeds.curve(lambda height_m: speed_limits(mission, height_m).blur_m_s, GREEN)
    speeds.parts.append(label(speeds.x(12), speeds.y(30), "blur", anchor="end", colour=GREEN))
    for height_m, colour in ((given_m, BLUE), (auto_m, RED)):
        found = speed_limits(mission, height_m).frames_m_s
        speeds.mark(height_m, found, f"{found:.1f}", colour, below=True)
    speeds.parts.append(label(speeds.x(34), speeds.y(33), "frames", anchor="start"))
    sides = side_view(mission, (given_m, auto_m))
    return drawing(WIDTH, HEIGHT, [*sides, *pixels.parts, *speeds.parts])


if __name__ == "__main__":
    sys.stdout.write(picture())
