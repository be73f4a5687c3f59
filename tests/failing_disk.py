"""A disk on which the n-th call fails, as SQLite tests each of its calls.

Calls of the modules `os`, `io` and `builtins` that change a file or a folder below a root count.
"""

from __future__ import annotations

import builtins
import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal
from unittest import mock

How = Literal["EIO", "ENOSPC", "short", "killed"]
HOWS: Final[tuple[How, ...]] = ("EIO", "ENOSPC", "short", "killed")
"""Faults of a call: an error, half of its bytes only, or an end of the process before it."""


class Killed(BaseException):
    """The process ends here."""


@dataclass(slots=True)
class FailingDisk:
    """Calls below a root, and the one that fails; calls from then on succeed, but for `killed`."""

    root: Path
    fails_at: int
    """The number of the call that fails, from 1; 0 for none."""
    how: How = "EIO"
    calls: list[str] = field(default_factory=list)
    """The name of each call with its file."""

    @property
    def failed(self) -> bool:
        return 0 < self.fails_at <= len(self.calls)

    def count(self, name: str, path: str, write_half: Callable[[], object] | None = None) -> None:
        """Count a call, and fail if it is its turn."""
        if self.how == "killed" and self.failed:
            raise Killed
        self.calls.append(f"{name} {Path(path).name}")
        if len(self.calls) != self.fails_at:
            return
        if self.how == "killed":
            raise Killed
        if self.how == "short" and write_half is not None:
            write_half()
        code = errno.EIO if self.how == "EIO" else errno.ENOSPC
        raise OSError(code, os.strerror(code), path)

    def below(self, what: Any) -> str | None:
        """Return the path of a file or a descriptor if it lies below the root."""
        try:
            path = (
                os.readlink(f"/proc/self/fd/{what}") if isinstance(what, int) else os.fspath(what)
            )
        except (OSError, TypeError):
            return None
        path = os.path.abspath(os.fsdecode(path))
        return path if path.startswith(f"{self.root}/") or path == str(self.root) else None


NAMES: Final = ("fsync", "ftruncate", "pwrite", "write", "replace", "rename", "mkdir", "unlink")
_OPENS_TO_WRITE: Final = os.O_WRONLY | os.O_RDWR | os.O_CREAT


@contextmanager
def failing_disk(root: Path, fails_at: int = 0, how: How = "EIO") -> Iterator[FailingDisk]:
    """Have the call of a number fail while the context lasts."""
    disk = FailingDisk(root.absolute(), fails_at, how)

    def seam(name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(what: Any, *more: Any, **how_to: Any) -> Any:
            if (path := disk.below(what)) is not None:
                half = None
                if name == "pwrite":
                    half = lambda: real(what, more[0][: len(more[0]) // 2], more[1])  # noqa: E731
                disk.count(name, path, half)
            return real(what, *more, **how_to)

        return call

    def opened(real: Callable[..., Any]) -> Callable[..., Any]:
        def call(file: Any, mode: Any = "r", *more: Any, **how_to: Any) -> Any:
            writes = mode & _OPENS_TO_WRITE if isinstance(mode, int) else set(mode) & set("wax+")
            if writes and not isinstance(file, int) and (path := disk.below(file)) is not None:
                disk.count("open", path)
            return real(file, mode, *more, **how_to)

        return call

    with ExitStack() as patches:
        for name in NAMES:
            patches.enter_context(mock.patch.object(os, name, seam(name, getattr(os, name))))
        patches.enter_context(mock.patch.object(os, "open", opened(os.open)))
        for module in (io, builtins):
            patches.enter_context(mock.patch.object(module, "open", opened(module.open)))
        yield disk
