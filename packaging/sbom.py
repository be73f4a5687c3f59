"""Write a bill of materials (CycloneDX 1.6) from resolved requirements: `make lock` calls it.

uv pip compile ... | python packaging/sbom.py > packaging/uavmap.cdx.json
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable
from typing import Any


def bill(lines: Iterable[str]) -> dict[str, Any]:
    """Return the bill of requirements such as `numpy==2.4.6 ; python_full_version < '3.12'`."""
    components = []
    for line in lines:
        if found := re.match(r"([A-Za-z0-9._-]+)==([^\s;\\]+)(?: *; *([^\\]+))?", line):
            name, version, marker = found.groups()
            purl = f"pkg:pypi/{name}@{version}"
            one = {"type": "library", "bom-ref": purl, "name": name, "version": version,
                   "purl": purl}  # fmt: skip
            components.append(one | ({"description": f"if {marker.strip()}"} if marker else {}))
    return {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": {"type": "application", "bom-ref": "uavmap", "name": "uavmap"}},
        "components": components,
        "dependencies": [{"ref": "uavmap", "dependsOn": [one["bom-ref"] for one in components]}],
    }


if __name__ == "__main__":
    print(json.dumps(bill(sys.stdin), indent=1))
