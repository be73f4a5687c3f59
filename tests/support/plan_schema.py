"""QGroundControl's plans, checked with a JSON schema that follows its documentation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator

SCHEMA: dict[str, Any] = json.loads(
    (Path(__file__).parents[1] / "data" / "qgroundcontrol-plan.schema.json").read_text("utf-8")
)


def faults_of(plan: object) -> list[str]:
    """Return the places where a plan differs from the documentation, with all reasons."""
    return [
        f"{error.json_path}: {part.message}"
        for error in Draft202012Validator(SCHEMA).iter_errors(plan)
        for part in (error, *(error.context or ()))
    ]
