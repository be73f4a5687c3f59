"""uavmap tune: train a detector on a few painted pictures."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, Final

from rich.markup import escape
from rich.table import Table

from missions.errors import OutputError
from uavmap.base.terminal import PipeConsole, Terminal
from uavmap.journal.results_folder import refuse_unwritable
from uavmap.photos.next_pictures import NEXT
from uavmap.photos.tune.paint_page import paint
from uavmap.photos.tune.selection import KINDS, SETS
from uavmap.photos.tune.study import Study
from uavmap.photos.tune.training import need_learner
from uavmap.photos.tune.tune_job import FILES, TuneSettings, tune
from uavmap.ui.cli.common import number_type, refuse_existing
from uavmap.ui.cli.option_table import add_options

EXAMPLES: Final = """\
  uavmap tune photos/ --paint --examples painted/ --out my-field      paint, then train
  uavmap tune photos/ --examples painted/ --out my-field
  uavmap tune photos/ --examples region.geojson --out my-field
  uavmap replay photos/ --mission field.toml --detector my-field
  uavmap fly field.toml --connect udpin://0.0.0.0:14550 --detector my-field
"""
NOTES: Final = """\
Paint at least two or three pictures in different light. The mask of photos/DJI_0021.JPG is
painted/DJI_0021.png, with the same proportions. White is region, black is not region, mid-grey is
not rated. Beside a classes.toml, gray values are numbers of classes (docs/how-to/classes.md).
Polygons in GeoJSON (longitude, latitude) are projected into the pictures by the poses in their
tags. Training needs scikit-learn, the extra `tune`.
"""
DESCRIPTION: Final = (
    "Train a detector on examples, test it on pictures that were not used for training, and write "
    "it for `replay` and `fly`."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("images", metavar="IMAGES", help="a folder of pictures (JPEG, PNG, TIFF)")
    parser.add_argument(
        "--examples",
        metavar="DIR",
        required=True,
        help="a folder of masks NAME.png or of polygons *.geojson, or one such file",
    )
    parser.add_argument(
        "--paint",
        action="store_true",
        help="first paint masks on a page in the browser; they go to the folder of --examples",
    )
    parser.add_argument(
        "--width",
        metavar="PX",
        type=number_type(int, 64, 4000),
        default=1000,
        help="the width at which pictures are judged, px (default 1000)",
    )
    parser.add_argument(
        "--cell-px",
        metavar="PX",
        type=number_type(float, 8, 1000),
        default=25.0,
        help="the side of a cell in a picture of that width, px (default 25)",
    )
    parser.add_argument(
        "--model",
        choices=KINDS,
        help="the model: logistic, trees or the mean of both (default: the best)",
    )
    parser.add_argument(
        "--features",
        choices=tuple(SETS),
        help="the features that the model uses (default: the best)",
    )
    add_options(parser, "tune")
    parser.set_defaults(seed=0)


def run(options: argparse.Namespace) -> int:
    """Paint masks and train a detector."""
    images, examples = Path(options.images), Path(options.examples)
    if options.out is None:
        if not options.paint:
            raise OutputError("--out is missing; give a folder for the detector")
        paint(images, examples, options.width, Terminal().show)
        return 0
    out = Path(options.out)
    refuse_existing(out, FILES)
    refuse_unwritable(out)
    settings = TuneSettings(
        options.seed,
        options.width,
        options.cell_px,
        (options.model,) if options.model else KINDS,
        (options.features,) if options.features else tuple(SETS),
    )
    if options.paint:
        need_learner()
        study = Study(images, examples, out, settings)
        paint(images, examples, options.width, Terminal().show, study)
        study.finish()
    report = tune(images, examples, out, settings, Terminal().show)
    if options.json:
        print(json.dumps(report, indent=2))
        return 0
    _show(report)
    print(f"detector in {out}: check {out}/overlays, then use it with --detector {out}")
    if rows := (out / NEXT).read_text("utf-8").splitlines():
        picture, area_m2 = rows[0].split("\t")
        print(f"paint {picture} next: it would decide {area_m2} sq m ({out / NEXT})")
    return 0


def _show(report: dict[str, Any]) -> None:
    title = f"{report['model']} on {report['features']}; each picture was left out of training"
    table = Table(title=title, title_justify="left")
    table.add_column("picture")
    for column in ("region", "pixels: precision", "recall", "IoU", "cells: precision", "recall",
                   "IoU", "sure"):  # fmt: skip
        table.add_column(column, justify="right")
    for row in report["pictures"]:
        share, sure = (f"{100 * row[key]:.0f} %" for key in ("region_share", "sure"))
        table.add_row(escape(row["picture"]), share, *_numbers(row), sure)
    table.add_section()
    table.add_row("all", "", *_numbers(report))
    PipeConsole().print(table)
    for one in report.get("classes", ()):
        figures = ", ".join(f"{key} {one[key]:.2f}" for key in ("precision", "recall"))
        print(f"{one['name']} ({one['number']}), by pixels: {figures}, IoU {one['iou']:.2f}")
    low, high = report["cell_iou_spread"]
    print(f"cell IoU from {low:.2f} to {high:.2f} over {len(report['pictures'])} pictures")
    bound = 100 * report["wrong_at_most"]
    print(f"in another picture at most {bound:.0f} % of its sure cells are wrong")


def _numbers(row: dict[str, Any]) -> list[str]:
    kinds = (row["pixels"], row["cells"])
    return [f"{kind[key]:.2f}" for kind in kinds for key in ("precision", "recall", "iou")]
