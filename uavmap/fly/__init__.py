"""A flight under way: service, vehicles, guardians, manoeuvres, imaging, people on the ground.

This package can be called: `uavmap.fly("runway", sim=True)` is `uavmap.api.fly`. Python gives a
package's name to whoever imports something of it, so a function beside it of the same name would be
gone after the first such import.
"""

from __future__ import annotations

import inspect
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uavmap.api import Results


class _CallablePackage(ModuleType):
    """This package, as a function."""

    def __call__(self, *arguments: Any, **options: Any) -> Results:
        """Fly a mission: see `uavmap.api.fly`."""
        from uavmap.api import fly  # noqa: PLC0415 - it is above, and takes a second

        return fly(*arguments, **options)

    @property
    def __signature__(self) -> inspect.Signature:
        from uavmap.api import fly  # noqa: PLC0415, as above

        return inspect.signature(fly)


sys.modules[__name__].__class__ = _CallablePackage
