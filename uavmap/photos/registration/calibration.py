"""A camera's calibration from a file, and pictures without distortion.

A file is OpenCV's YAML or XML, or JSON with the same keys. These are read: `camera_matrix` (or
`cameraMatrix`, `K`), `distortion_coefficients` (or `dist_coeffs`, `distCoeffs`, `D`), the size
(`image_width` and `image_height`, or `width` and `height`). `camera_model` or `distortion_model` is
a fisheye's if it contains "fisheye" or "equidistant".
"""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from missions.errors import ImageError
from missions.mission.schema import Mission
from uavmap.photos.sources.photo_file import text_beside
from uavmap.photos.sources.picture_record import Picture
from vision.camera import Camera, Lens, Model, Straightening, straightening

_LARGEST_BYTES: Final = 2**20
_MATRIX: Final = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "M1")
_DISTORTION: Final = (
    "distortion_coefficients",
    "Distortion_Coefficients",
    "dist_coeffs",
    "dist_coeff",
    "distCoeffs",
    "D",
    "D1",
)
_WIDTH: Final = ("image_width", "image_Width", "width")
_HEIGHT: Final = ("image_height", "image_Height", "height")
_MODEL: Final = ("camera_model", "distortion_model", "model", "fisheye_model")


def calibration_of(
    given: str | None, mission: Mission | None, mission_file: str | None
) -> Lens | None:
    """Return the lens of --calibration, else of a mission, if any. Raises `ImageError`."""
    if given is not None:
        return read_calibration(Path(given))
    if mission is None or mission.camera.calibration is None:
        return None
    beside = Path(mission_file or ".").parent
    return read_calibration(beside / mission.camera.calibration)


def read_calibration(path: Path) -> Lens:
    """Return the lens in a calibration file. Raises `ImageError`: the file, the key, the remedy."""
    text = text_beside(path, _LARGEST_BYTES)
    values = _from_json(text, path) if text.lstrip().startswith("{") else _from_opencv(text, path)
    matrix, size = values.get("matrix"), (values.get("width"), values.get("height"))
    if matrix is None or len(matrix) != 9:
        raise ImageError(f"{path}: camera_matrix: expected 3 x 3 numbers")
    if not all(isinstance(side, (int, float)) and side >= 1 for side in size):
        raise ImageError(f"{path}: image_width and image_height: expected the size in pixels")
    name = str(values.get("model", "")).lower()
    model: Model = "fisheye" if "fisheye" in name or "equidistant" in name else "brown"
    distortion = tuple(values.get("distortion") or ())
    if model == "brown" and len(distortion) > 8:
        if any(distortion[8:]):
            raise ImageError(
                f"{path}: distortion_coefficients: {len(distortion)} numbers; thin prisms and "
                "tilted sensors are not supported: calibrate with 4, 5 or 8"
            )
        distortion = distortion[:8]
    fx, _, cx, _, fy, cy = matrix[:6]
    try:
        return Lens(int(size[0]), int(size[1]), fx, fy, cx, cy, model, distortion)  # type: ignore[arg-type]
    except (ValueError, OverflowError) as error:
        raise ImageError(f"{path}: {error}") from None


def _from_json(text: str, path: Path) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ImageError(f"{path}: not a JSON file ({error})") from None

    def first(keys: Iterable[str]) -> Any:
        return next((found[key] for key in keys if key in found), None)

    values = {
        "matrix": _numbers(first(_MATRIX), path, "camera_matrix"),
        "distortion": _numbers(first(_DISTORTION), path, "distortion_coefficients"),
        "width": first(_WIDTH),
        "height": first(_HEIGHT),
    }
    size = found.get("image_size", found.get("img_size"))
    if values["width"] is None and isinstance(size, list) and len(size) == 2:
        values["width"], values["height"] = size
    return values | {"model": first(_MODEL) or ""}


def _numbers(value: Any, path: Path, key: str) -> list[float] | None:
    if isinstance(value, dict):  # as OpenCV writes matrices into JSON
        value = value.get("data")
    if value is None:
        return None
    try:
        return [float(x) for x in np.asarray(value, dtype=np.float64).ravel()]
    except (TypeError, ValueError):
        raise ImageError(f"{path}: {key}: expected numbers") from None


def _from_opencv(text: str, path: Path) -> dict[str, Any]:
    flags = cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
    try:
        storage = cv2.FileStorage(_with_directive(text), flags)
        opened = storage.isOpened()
    except (cv2.error, SystemError):  # of the binding, whose constructor failed
        opened = False
    if not opened:
        raise ImageError(f"{path}: not a YAML, XML or JSON file of OpenCV's calibration")

    def matrix(keys: Iterable[str]) -> list[float] | None:
        # not by `FileNode.mat`, which writes beyond a matrix whose columns are not stated
        for node in map(storage.getNode, keys):
            if node.isMap() and (data := node.getNode("data")).isSeq():
                found = [data.at(k) for k in range(data.size())]
                if all(one.isInt() or one.isReal() for one in found):
                    return [float(one.real()) for one in found]
        return None

    def number(keys: Iterable[str]) -> float | None:
        nodes = (storage.getNode(key) for key in keys)
        return next((node.real() for node in nodes if node.isInt() or node.isReal()), None)

    def word(keys: Iterable[str]) -> str:
        nodes = (storage.getNode(key) for key in keys)
        return next((node.string() for node in nodes if node.isString()), "")

    try:
        return {
            "matrix": matrix(_MATRIX),
            "distortion": matrix(_DISTORTION),
            "width": number(_WIDTH),
            "height": number(_HEIGHT),
            "model": word(_MODEL),
        }
    except cv2.error as error:
        raise ImageError(f"{path}: not OpenCV's: {error.err}") from None
    finally:
        storage.release()


def _with_directive(text: str) -> str:
    """Add the first line that OpenCV needs to recognise YAML."""
    if text.lstrip().startswith(("<?xml", "%YAML", "<")):
        return text.lstrip()
    return "%YAML:1.0\n---\n" + text.removeprefix("---\n")


# --- pictures without distortion -----------------------------------------------------------------
@dataclass(slots=True)
class Lenses:
    """Lenses of pictures: the given calibration, their tags', or a pinhole of `hfov_deg`."""

    hfov_deg: float
    given: Lens | None = None
    _plans: dict[Lens, Straightening] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __reduce__(self) -> tuple[object, ...]:
        """Return the parts to pickle: not the lock, and not the plans, which are made anew."""
        return Lenses, (self.hfov_deg, self.given)

    def lens(self, picture: Picture) -> Lens:
        """Return the lens of the picture at its full size."""
        if lens := self.given or picture.lens:
            return lens
        return Lens.pinhole(math.radians(self.hfov_deg), picture.width_px, picture.height_px)

    def straightened(
        self, image: NDArray[np.uint8], lens: Lens
    ) -> tuple[NDArray[np.uint8], Camera]:
        """Return a decoded picture without distortion, and the pinhole that fits it."""
        rows, columns = image.shape[:2]
        if lens.is_pinhole:
            return image, Camera(lens.hfov_rad, columns, rows)
        plan = self._plan(lens.scaled(columns, rows))
        return plan.applied(image), plan.camera

    def _plan(self, lens: Lens) -> Straightening:
        # tags give each picture another focal length, and each map is expensive
        alike = replace(lens, fx_px=round(lens.fx_px, 1), fy_px=round(lens.fy_px, 1))
        with self._lock:
            plan = self._plans.get(alike)
            if plan is None:
                if len(self._plans) >= 4:
                    self._plans.clear()
                plan = self._plans[alike] = straightening(alike)
            return plan
