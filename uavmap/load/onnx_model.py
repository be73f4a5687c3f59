"""Segmentation models in ONNX format, run by onnxruntime (the extra `onnx`)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from missions.errors import ImageError, MissionFileError
from missions.mission.messages import explain
from missions.mission.schema import parse_toml
from uavmap.base.extras import install_command
from uavmap.base.text_files import read_text
from vision.detectors import Detector, build_detector
from vision.detectors.onnx import OnnxDetector, OnnxSettings, Run

LARGEST_TOML: Final = 100_000


def onnx_detector(path: Path, data: bytes, parameters: Mapping[str, Any]) -> Detector:
    """Return the detector of an ONNX file and the TOML of the same name beside it.

    Raises `MissionFileError` without the extra, and for faults of the files.
    """
    settings = onnx_settings(path)
    run: Run = _Session(data)
    return build_detector("onnx", OnnxDetector, {"run": run, "settings": settings, **parameters})


def onnx_settings(model: Path) -> OnnxSettings:
    """Return the settings beside the file of a model. Raises `MissionFileError`."""
    path = model.with_suffix(".toml")
    try:
        return OnnxSettings.model_validate(parse_toml(read_text(path, LARGEST_TOML), str(path)))
    except OSError as error:
        raise MissionFileError(
            f"{path} cannot be read ({error.strerror}); write it: tile_px, scale, mean, std, ..."
        ) from None
    except ValidationError as error:
        raise MissionFileError(f"{path}: {explain(error, OnnxSettings)[0]}") from None
    except ValueError as error:
        raise MissionFileError(f"{path}: not a TOML file: {error}") from None


class _Session:
    """A model in a session of onnxruntime. Pickle copies its bytes, and creates a new session."""

    def __init__(self, data: bytes) -> None:
        try:
            import onnxruntime  # noqa: PLC0415 - an extra
        except ImportError:
            raise MissionFileError(
                f"a segmentation model needs onnxruntime: {install_command('onnx')}"
            ) from None
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 4
        options.intra_op_num_threads = 1  # other cores judge the pictures of other vehicles
        try:
            session = onnxruntime.InferenceSession(
                data, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # the runtime's errors have no common class
            raise MissionFileError(
                f"not a model that onnxruntime can read ({_first(error)})"
            ) from None
        inputs = session.get_inputs()
        if len(inputs) != 1:
            raise MissionFileError(f"the model has {len(inputs)} inputs; one is expected: pictures")
        self._data, self._session, self._input = data, session, inputs[0].name

    def __reduce__(self) -> tuple[object, ...]:
        return _Session, (self._data,)

    def __call__(self, batch: NDArray[np.float32]) -> NDArray[Any]:
        try:
            return np.asarray(self._session.run(None, {self._input: batch})[0])
        except Exception as error:
            raise ImageError(f"the model cannot judge a tile ({_first(error)})") from None


def _first(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]
