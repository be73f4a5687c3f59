"""Tests that are coroutines: each names its runner."""

from __future__ import annotations

import asyncio
import functools
import inspect
from collections.abc import Callable, Coroutine
from typing import Any

from uavmap.base.clock import VirtualClock, run

Body = Callable[..., Coroutine[Any, Any, None]]


def by(runner: Callable[..., object], *how: Any) -> Callable[[Body], Callable[..., None]]:
    """Make a test of a coroutine that `runner(body, *how)` runs.

    The runner fills the parameters before the `/`; those after it are fixtures. A callable in `how`
    is called first, with those of the test's own arguments that it names.
    """

    def test_of(body: Body) -> Callable[..., None]:
        parameters = inspect.signature(body).parameters.values()

        @functools.wraps(body)
        def test(**given: Any) -> None:
            runner(
                lambda *handed: body(*handed, **given),
                *(_made(value, given) if callable(value) else value for value in how),
            )

        own = [p for p in parameters if p.kind is not p.POSITIONAL_ONLY]
        test.__signature__ = inspect.Signature(own)  # type: ignore[attr-defined]
        return test

    return test_of


def _made(make: Callable[..., Any], given: dict[str, Any]) -> Any:
    parameters = inspect.signature(make).parameters.values()
    named = {p.name for p in parameters if p.kind is not p.VAR_KEYWORD}
    return make(**{name: value for name, value in given.items() if name in named})


def on_virtual_time(body: Body) -> None:
    """Run a body on a clock that advances only when no task is ready."""
    run(body(), VirtualClock())


def in_real_time(body: Body) -> None:
    """Run a body as a program would."""
    asyncio.run(body())
