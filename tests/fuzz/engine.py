"""Runs of changed inputs: each is accepted, or refused with an error of the product.

An input fails with any other error, a wrong result (`AssertionError`), more than `MAX_S` of CPU
time, or more than `MAX_BYTES` of memory.
"""

from __future__ import annotations

import os
import random
import re
import resource
import signal
import sys
import time
import traceback
import types
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from missions.errors import UavmapError

ROOT: Final = Path(__file__).parents[2]
KEPT: Final = Path(__file__).with_name("kept")
MAX_S: Final = 2.0
"""Maximum CPU time of an input, s; coverage takes about a third of it."""
MAX_BYTES: Final = 400 << 20
"""Maximum growth of the memory of the process by an input, bytes."""
LONGEST: Final = 1 << 17
"""Maximum length of an input, bytes."""
_PIECES: Final = (
    b"", b"\0", b"\xff" * 4, b"\x7f" + b"\xff" * 7, b"nan", b"1e999", b"-1", b"0", b"9" * 20,
    b"null", b"true", b"[]", b"{}", b'""', b"[" * 5000, b"(" * 5000, b"<a>" * 3000, b"\xed\xa0\x80",
    b"\n",
)  # fmt: skip
_NUMBER: Final = re.compile(rb"-?\d+(\.\d+)?")


@dataclass(frozen=True, slots=True)
class Target:
    """A door of the program."""

    name: str
    examples: Callable[[Path], Sequence[bytes]]
    """Inputs that the product or its companions have written; they may need a folder."""
    check: Callable[[bytes, Path], None]
    """Hand an input to the program, in an empty folder."""


@dataclass(slots=True)
class Result:
    """The results of a run."""

    executions: int = 0
    edges: int | None = None
    """Branches of the program that inputs took; None without coverage."""
    found: dict[str, bytes] = field(default_factory=dict)
    """An input for each failure."""


class _TooLongError(BaseException):
    """An input took too long; not an `Exception`, which a reader of damaged files may catch."""


def fault(target: Target, data: bytes, folder: Path, most_s: float = MAX_S) -> str | None:
    """Return how and where an input fails; None if it is accepted or refused."""
    before = _memory()
    old = signal.signal(signal.SIGPROF, _stop)
    signal.setitimer(signal.ITIMER_PROF, most_s)
    try:
        target.check(data, folder)
    except UavmapError:
        pass
    except (Exception, _TooLongError) as error:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        return f"{type(error).__name__.strip('_')} at {_place(error)}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, old)
    return f"more than {MAX_BYTES >> 20} MB" if _memory() - before > MAX_BYTES else None


def _stop(number: int, frame: types.FrameType | None) -> None:
    raise _TooLongError


def _memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10


def _place(error: BaseException) -> str:
    """Return the innermost function of the project in which an error was raised."""
    ours = tuple(f"{ROOT / name}/" for name in ("missions", "vision", "sitl", "uavmap", "tests"))
    frames = traceback.extract_tb(error.__traceback__)
    last = [f for f in frames if f.filename.startswith(ours) and f.filename != __file__][-1]
    return f"{os.path.relpath(last.filename, ROOT)}:{last.name}"


def changed(rng: random.Random, data: bytes, examples: Sequence[bytes]) -> bytes:
    """Return an input with some changes."""
    made = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 5))):
        at = rng.randrange(len(made) + 1)
        end = min(at + rng.choice((1, 2, 4, 16, 64)), len(made))
        kind = rng.randrange(7)
        if kind == 0 and at < len(made):
            made[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            del made[at:end]
        elif kind == 2:
            made[at:at] = made[at:end] * rng.choice((1, 2, 60))
        elif kind == 3:
            made[at:end] = rng.randbytes(end - at)
        elif kind == 4:
            other = rng.choice(examples)
            begin = rng.randrange(len(other) + 1)
            made[at:end] = other[begin : begin + rng.choice((4, 16, 64, 1024))]
        elif kind == 5 and (numbers := list(_NUMBER.finditer(made))):
            one = rng.choice(numbers)
            made[one.start() : one.end()] = rng.choice(_PIECES)
        else:
            made[at:end] = rng.choice(_PIECES)
    return bytes(made[:LONGEST])


def plain(
    target: Target,
    examples: Sequence[bytes],
    folder: Path,
    seed: int,
    executions: int,
    seconds: float,
) -> Result:
    """Change examples at random, up to a number of executions or a CPU time.

    An input that is the first to get an answer is changed further.
    """
    rng, result, answers = random.Random(seed), Result(), set[str]()
    inputs = list(examples)

    def check(data: bytes, where: Path) -> None:
        try:
            target.check(data, where)
        except UavmapError as error:
            answer = re.sub(r"\d+", "", str(error))[:200]
            if answer not in answers and len(answers) < 1000:
                answers.add(answer)
                inputs.append(data)
            raise

    noting = Target(target.name, target.examples, check)
    end_s = time.process_time() + seconds
    while result.executions < executions and time.process_time() < end_s:
        _execute(noting, changed(rng, rng.choice(inputs), inputs), folder, result)
    return result


def _execute(target: Target, data: bytes, folder: Path, result: Result) -> None:
    result.executions += 1
    if (failure := fault(target, data, folder)) is not None:
        result.found.setdefault(failure, data)


def guided(
    target: Target,
    examples: Sequence[bytes],
    folder: Path,
    seed: int,
    seconds: float,
    end: Callable[[Result], None],
) -> None:
    """Change inputs that reach new branches, by atheris; `end` gets the result.

    The process ends with it: libFuzzer does not return. It keeps an input that ends the process.
    """
    import atheris  # noqa: PLC0415 - for long runs only

    result, crashes = Result(), KEPT / target.name
    crashes.mkdir(parents=True, exist_ok=True)
    corpus, log = folder / "corpus", folder / "log"
    corpus.mkdir()
    for number, data in enumerate(examples):
        (corpus / str(number)).write_bytes(data)
    work = folder / "work"
    work.mkdir()
    out = os.dup(2)
    os.dup2(os.open(log, os.O_CREAT | os.O_WRONLY), 2)
    end_s = time.process_time() + seconds

    def one(data: bytes) -> None:
        _execute(target, data, work, result)
        if time.process_time() > end_s:
            sys.stderr.flush()
            os.dup2(out, 2)
            covered = re.findall(r"cov: (\d+)", log.read_text("utf-8", "replace"))
            result.edges = int(covered[-1]) if covered else None
            end(result)
            os._exit(0)

    def mutate(data: bytes, most: int, number: int) -> bytes:
        if number % 2:
            return bytes(atheris.Mutate(data, most))
        return changed(random.Random(number), data, examples)[:most]

    options = [
        f"-artifact_prefix={crashes}/",
        f"-seed={seed}",
        f"-max_len={LONGEST}",
        "-rss_limit_mb=0",
        "-timeout=86400",
        "-len_control=0",
    ]
    atheris.Setup(["fuzz", *options, str(corpus)], one, custom_mutator=mutate)
    atheris.Fuzz()


def kept(name: str) -> Iterator[Path]:
    """Yield the files of a target's inputs that failed once."""
    folder = KEPT / name
    if folder.is_dir():
        yield from sorted(folder.iterdir())


def keep(target: Target, failure: str, data: bytes) -> Path:
    """Write an input that fails into the folder of kept ones."""
    words = re.sub(r"[^A-Za-z0-9]+", "-", failure).strip("-").lower()
    path = KEPT / target.name / words
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path
