"""ROIs from files: what is read, and the error of a broken file."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from missions.errors import RoiError, UavmapError
from missions.lab.arena.roi import KINDS, MAX_CELLS, boundary, component, grown
from missions.units import Cell, LatLon
from uavmap.lab.roi_files import load_rois

LON, LAT = -91.994, 46.842
M_EAST, M_NORTH = 1 / 76_240.0, 1 / 111_180.0  # degrees per metre there


def written(folder: Path, value: object, name: str = "rois.json") -> str:
    path = folder / name
    path.write_text(value if isinstance(value, str) else json.dumps(value), "utf-8")
    return str(path)


def block(east_m: float, north_m: float, width_m: float, height_m: float) -> list[list[float]]:
    corners = [(0, 0), (width_m, 0), (width_m, height_m), (0, height_m), (0, 0)]
    return [[LON + (east_m + e) * M_EAST, LAT + (north_m + n) * M_NORTH] for e, n in corners]


def refusal(folder: Path, value: object, **options: Any) -> str:
    path = written(folder, value)
    with pytest.raises(RoiError) as caught:
        load_rois(path, **options)
    text = str(caught.value)
    assert "\n" not in text
    return text.removeprefix(f"{path}: ")


# --- sets of cells ---------------------------------------------------------------------------
def test_sets_of_rois_are_read(tmp_path):
    rois = [
        {"start": [0, 0], "cells": [[0, 1], [0, 0]], "seed": 5},
        {"start": [-7, 3], "cells": [[-7, 3]]},
    ]
    one, other = load_rois(written(tmp_path, {"kind": "E", "rois": rois}))
    assert (one.start, one.cells) == (Cell(0, 0), {Cell(0, 0), Cell(0, 1)})
    assert other.cells == {Cell(-7, 3)}
    assert other.name == "rois[1]"


FAULTS: dict[str, tuple[object, str]] = {
    "no list": ({"rois": {}}, "rois = {}: expected a list with at least one ROI"),
    "nothing": ({"rois": []}, "rois = []: expected a list with at least one ROI"),
    "no ROI": ({"rois": [7]}, "rois[0] = 7: expected {"),
    "no start": ({"rois": [{"cells": [[0, 0]]}]}, "rois[0].start: missing"),
    "no cells": ({"rois": [{"start": [0, 0]}]}, "rois[0].cells: missing"),
    "empty": ({"rois": [{"start": [0, 0], "cells": []}]}, "rois[0].cells = []: expected a list"),
    "cells of another kind": (
        {"rois": [{"start": [0, 0], "cells": "all"}]},
        'rois[0].cells = "all": expected a list',
    ),
    "a triple": ({"rois": [{"start": [0, 0, 0], "cells": [[0, 0]]}]}, "rois[0].start = [0, 0, 0]"),
    "a fraction": (
        {"rois": [{"start": [0, 0], "cells": [[0, 0], [0, 1.5]]}]},
        "rois[0].cells[1] = [0, 1.5]: expected two whole numbers",
    ),
    "true": ({"rois": [{"start": [0, 0], "cells": [[0, True]]}]}, "cells[0] = [0, true]"),
    "nothing at all": ({"rois": [{"start": None, "cells": [[0, 0]]}]}, "rois[0].start = null"),
    "NaN": ('{"rois": [{"start": [0, 0], "cells": [[NaN, 0]]}]}', "cells[0] = [NaN, 0]"),
    "infinite": ('{"rois": [{"start": [0, 0], "cells": [[1e999, 0]]}]}', "expected two whole"),
    "huge": (
        {"rois": [{"start": [0, 0], "cells": [[0, 0], [10**400, 0]]}]},
        "...: farther out than 2147483648 cells",
    ),
    "twice": (
        {"rois": [{"start": [0, 0], "cells": [[0, 0], [0, 1], [0, 0]]}]},
        "rois[0].cells[2] = [0, 0]: is cells[0] again",
    ),
    "a start elsewhere": (
        {"rois": [{"start": [5, 5], "cells": [[0, 0]]}]},
        "rois[0].start = [5, 5]: not among the cells",
    ),
    "in two parts": (
        {"rois": [{"start": [0, 0], "cells": [[0, 0], [1, 1]]}]},
        "rois[0].cells[1] = [1, 1]: is not connected with the start",
    ),
    "the second": (
        {"rois": [{"start": [0, 0], "cells": [[0, 0]]}, {"start": [0, 0], "cells": [[0]]}]},
        "rois[1].cells[0] = [0]",
    ),
    "a number": ("7", "neither"),
    "other keys": ({"cells": []}, "neither"),
    "no JSON": ("roi", "not JSON"),
    "too many digits": ("1" * 5000, "not JSON"),
    "too deep": ("[" * 100_000, "not JSON"),
    "no file at all": ("", "not JSON"),
}


def test_unreadable_file_is_refused(tmp_path):
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    for name in (tmp_path, tmp_path / "binary", tmp_path / "nowhere", "x" * 5000, "a\0b"):
        with pytest.raises(RoiError, match="cannot be read"):
            load_rois(str(name))


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(
                ["rois", "start", "cells", "type", "coordinates", "geometry", "features"]
            ),
            inner,
        )
    ),
    max_leaves=12,
)


@given(json_values)
def test_arbitrary_content_is_read_or_refused(tmp_path_factory, value):
    path = written(tmp_path_factory.getbasetemp(), value, "any.json")
    for whole in (value, {"rois": [value]}, {"type": "Polygon", "coordinates": value}):
        written(tmp_path_factory.getbasetemp(), whole, "any.json")
        with contextlib.suppress(RoiError):
            assert load_rois(path)


# --- GeoJSON ---------------------------------------------------------------------------------
def test_polygons_are_rois_of_their_own(tmp_path):
    shape = {"type": "MultiPolygon", "coordinates": [[block(0, 0, 40, 20)], [block(99, 0, 20, 20)]]}
    path = written(tmp_path, {"type": "Feature", "properties": {}, "geometry": shape}, "lake.json")
    one, other = load_rois(path, cell_m=4.0)
    assert (one.name, other.name) == ("lake[1]", "lake[2]")
    assert len(one.cells) == pytest.approx(50, abs=12)
    for roi in (one, other):
        assert component(roi.cells, roi.start) == roi.cells
        assert roi.start in boundary(roi.cells)
    (coarse, _) = load_rois(path, cell_m=10.0)
    assert len(coarse.cells) == pytest.approx(8, abs=4)


def test_polygons_with_a_start_are_one_roi(tmp_path):
    parts = [[block(0, 0, 40, 20)], [block(38, 0, 40, 20)], [block(300, 0, 20, 20)]]
    path = written(tmp_path, {"type": "MultiPolygon", "coordinates": parts}, "lake.json")
    inside = LatLon(LAT + 10 * M_NORTH, LON + 10 * M_EAST)
    (roi,) = load_rois(path, cell_m=4.0, start=inside)
    assert roi.start == Cell(0, 0)
    assert len(roi.cells) == pytest.approx(78 * 20 / 16, abs=15)  # not the far one
    assert max(cell.east for cell in roi.cells) >= 16
    outside = LatLon(LAT - 100 * M_NORTH, LON)
    with pytest.raises(RoiError, match="is not in the region") as refusal:
        load_rois(path, start=outside)
    near = str(refusal.value).rpartition("--start ")[2]  # the entry that it names instead is valid
    lat_deg, lon_deg = map(float, near.split(","))
    assert len(load_rois(path, start=LatLon(lat_deg, lon_deg))[0].cells) > 80
    with pytest.raises(RoiError, match="84"):
        load_rois(path, start=LatLon(89.0, LON))


@pytest.mark.parametrize(("east_m", "north_m"), [(0, 0), (40, 20), (0, 20), (20, 0), (20, 21)])
def test_start_at_the_rim_is_its_nearest_cell(tmp_path, east_m, north_m):
    """A cell around a corner is covered by a quarter."""
    shape = {"type": "Polygon", "coordinates": [block(0, 0, 40, 20)]}
    path = written(tmp_path, shape, "lake.json")
    corner = LatLon(LAT + north_m * M_NORTH, LON + east_m * M_EAST)
    (roi,) = load_rois(path, cell_m=4.0, start=corner)
    assert max(map(abs, roi.start)) <= 1
    assert roi.start in boundary(roi.cells)
    assert len(roi.cells) == pytest.approx(50, abs=12)


def polygon(*points: list[float]) -> dict[str, object]:
    return {"type": "Polygon", "coordinates": [list(points)]}


SHAPES: dict[str, tuple[object, str]] = {
    "a point": ({"type": "Point", "coordinates": [LON, LAT]}, "no Polygon"),
    "no features": ({"type": "FeatureCollection", "features": []}, "no Polygon"),
    "an unknown type": ({"type": "Blob"}, "not GeoJSON"),
    "no coordinates": ({"type": "Polygon"}, "not GeoJSON"),
    "text": (polygon(["x", 1], [0, 1], [0, 0], ["x", 1]), "not GeoJSON"),  # type: ignore[list-item]
    "open": (polygon([0, 0], [1, 0], [1, 1]), "not GeoJSON"),
    "empty": ({"type": "Polygon", "coordinates": []}, "polygon 1: expected"),
    "metres": (polygon([5e5, 5e6], [5e5 + 9, 5e6], [5e5, 5e6 + 9], [5e5, 5e6]), "in degrees"),
    "crossed": (
        polygon([LON, LAT], [LON + 1e-4, LAT + 1e-4], [LON, LAT + 1e-4], [LON + 1e-4, LAT],
                [LON, LAT]),
        "polygon 1: Self-intersection",
    ),
    "tiny": (polygon(*block(0, 0, 0.1, 0.1)), "half of no cell of 4 m; choose a smaller --cell-m"),
    "a continent": (polygon([0, 40], [5, 40], [5, 45], [0, 40]), "choose a larger --cell-m"),
    "a world": (polygon([-180, -80], [180, -80], [180, 80], [-180, -80]), "wider than"),
    "the pole": (polygon([0, 86], [3, 86], [3, 87], [0, 86]), "84"),
}  # fmt: skip


@pytest.mark.parametrize(("value", "words"), [*FAULTS.values(), *SHAPES.values()],
                         ids=[*FAULTS, *SHAPES])  # fmt: skip
def test_faults_are_reported_with_their_place(tmp_path, value, words):
    text = refusal(tmp_path, value)
    assert words in text
    assert len(text) < 200


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (polygon(*block(0, 0, 2, 2)), "covers half of no cell of 4 m"),
        ({"rois": [{"start": [0, 0], "cells": [[0, 0]]}]}, "leave out --start"),
    ],
)
def test_invalid_start_is_refused(tmp_path, value, words):
    assert words in refusal(tmp_path, value, start=LatLon(LAT, LON))


# --- growths ---------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_growths_are_grown_by_name(kind):
    for cells in (1, 2, 60):
        assert load_rois(f"{kind}:{cells}:3") == [grown(kind, cells, 3)]


@pytest.mark.parametrize(
    "name",
    ["eden", "eden:", "eden:12", "eden:0:1", "eden:12:1:1", "eden:-3:1", "eden:1e3:1", "eden:x:1",
     f"eden:{MAX_CELLS + 1}:1", "eden:9" + "9" * 400 + ":1", "eden:²:1"],
)  # fmt: skip
def test_invalid_names_of_growths_are_refused(name):
    with pytest.raises(UavmapError):
        load_rois(name)
