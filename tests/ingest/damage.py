"""Damage of files, at random and by cuts, and what readers must make of it: a result with its account or `InputError`.

A reader may not raise anything else, hang, or take much memory; its account has to add up, and of a file that was cut
off the whole records have to arrive.
"""

from __future__ import annotations

import faulthandler
import os
import resource
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from tests.ingest.sample_logs import Records, Sample
from wheelprint.ingest.account import KEPT_REJECTIONS, Account
from wheelprint.ingest.readers import recognise
from wheelprint.schemas.errors import InputError

LONGEST = 10.0
"""Seconds of computing that one file may take, the reader's own processes included."""
HANGS = 120.0
"""Seconds on the clock, on however busy a machine, after which the process is ended with a traceback."""
MEMORY = 512 << 20
NEW = 210 << 20
"""Bytes that all of them may take."""
BEYOND = 1 << 30
"""Bytes more than at the start that the process gets at all, so that a reader that runs wild does not take others."""

Content = bytearray
Harm = Callable[[np.random.Generator, Content], object]


def _stretch(random: np.random.Generator, content: Content, longest: int = 64) -> slice:
    begin = int(random.integers(len(content)))
    return slice(begin, begin + int(random.integers(1, longest)))


def flip_bits(random: np.random.Generator, content: Content) -> None:
    for bit in random.integers(0, 8 * len(content), random.integers(1, 9)).tolist():
        content[bit // 8] ^= 1 << bit % 8


def overwrite(random: np.random.Generator, content: Content) -> None:
    place = _stretch(random, content)
    content[place] = random.bytes(len(content[place]))


def insert(random: np.random.Generator, content: Content) -> None:
    place = int(random.integers(len(content)))
    content[place:place] = random.bytes(int(random.integers(1, 64)))


def delete(random: np.random.Generator, content: Content) -> None:
    del content[_stretch(random, content, 200)]


def swap(random: np.random.Generator, content: Content) -> None:
    """Exchange two stretches of one length."""
    one, other = sorted(random.integers(0, len(content), 2).tolist())
    size = int(random.integers(0, min(other - one, len(content) - other, 300) + 1))
    one, other = slice(one, one + size), slice(other, other + size)
    content[one], content[other] = content[other], content[one]


def repeat(random: np.random.Generator, content: Content) -> None:
    place = _stretch(random, content, 300)
    content[place.start : place.start] = content[place]


def empty_or_fill(random: np.random.Generator, content: Content) -> None:
    """Set what may be a length of 1, 2, 4 or 8 bytes to 0, to all ones or to the most that is positive."""
    size = int(random.choice([1, 2, 4, 8]))
    place = int(random.integers(len(content))) // size * size
    content[place : place + size] = [bytes(size), b"\xff" * size, b"\xff" * (size - 1) + b"\x7f"][random.integers(3)]


def lengthen_number(random: np.random.Generator, content: Content) -> None:
    """Write digits where one stands."""
    digits = [place for place, octet in enumerate(content) if octet in b"0123456789"]
    if digits:
        place = int(random.choice(digits))
        written = [b"9" * int(random.integers(1, 40)), b"-1", b"0", b"1e400", b"nan", b"1_0", b"0x7f", b""]
        content[place : place + 1] = written[random.integers(len(written))]


def extend(random: np.random.Generator, content: Content) -> None:
    content += random.choice([random.bytes(int(random.integers(1, 200))), bytes(content), bytes(100)])


def shorten(random: np.random.Generator, content: Content) -> None:
    del content[int(random.integers(len(content))) :]


HARMS: tuple[Harm, ...] = (
    flip_bits, flip_bits, overwrite, insert, delete, swap, repeat, empty_or_fill, empty_or_fill, lengthen_number,
    extend, shorten,
)  # fmt: skip


def mutations(seed: int, content: bytes, seal: Callable[[bytes], bytes] | None) -> bytes:
    """Return a file damaged in one to three ways, with its checksums made right in half of the cases."""
    random = np.random.default_rng(seed)
    damaged = Content(content)
    for _ in range(random.integers(1, 4)):
        if damaged:
            HARMS[random.integers(len(HARMS))](random, damaged)
    return seal(bytes(damaged)) if seal and seed % 2 else bytes(damaged)


@dataclass
class Outcome:
    """How the readings of one format ended.

    Attributes:
        mutations: Files that were damaged at random.
        cuts: Files that were cut off.
        results: Readings that ended with records and an account.
        refusals: Readings that ended with `InputError`.
        slowest: s of computing, of one file.
        memory: Bytes that the process had at most, or one that it started.
        failures: What should not have been.
    """

    mutations: int = 0
    cuts: int = 0
    results: int = 0
    refusals: int = 0
    slowest: float = 0.0
    memory: int = 0
    failures: list[str] = field(default_factory=list)


def damage(name: str, sample: Sample, mutated: int, cut: int, folder: Path) -> Outcome:
    """Read a sample's file after so many mutations and cuts of it, made in a folder; the name gives the seeds."""
    outcome = Outcome()
    path = sample.write(folder)
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    sound = {file: file.read_bytes() for file in files}
    complete, account = _read(sample, path)
    if isinstance(complete, InputError) or account.rejected or account.truncated or len(complete) < 2:
        outcome.failures.append(f"sound: {complete}, {account}")
        return outcome
    if sample.whole is not None and sample.whole(sound[path])[0] != account.accepted:
        outcome.failures.append(f"sound: {account.accepted} accepted, {sample.whole(sound[path])[0]} in the file")

    def attempt(what: str, check: Callable[[Records | InputError, Account], str]) -> None:
        faulthandler.dump_traceback_later(HANGS, exit=True)
        start = sum(os.times()[:4])
        try:
            result, account = _read(sample, path)
            reason = _doubt(path, sample, result, account) or check(result, account)
        except Exception as error:  # noqa: BLE001  it is what must not come
            result, reason = [], f"{type(error).__name__}: {error}"
        took = sum(os.times()[:4]) - start
        faulthandler.cancel_dump_traceback_later()
        outcome.slowest = max(outcome.slowest, took)
        if isinstance(result, InputError):
            outcome.refusals += 1
        elif not reason:
            outcome.results += 1
        if reason or took > LONGEST:
            outcome.failures.append(f"{what}: {reason or f'{took:.1f} s'}")

    with _bounded(outcome):
        for number in range(mutated):
            # One file in turn where a recording consists of several.
            file = files[number % len(files)]
            content = mutations(1000 * zlib.crc32(name.encode()) + number, sound[file], sample.seal)
            file.write_bytes(content)
            every = sample.every(content) if sample.every else -1
            attempt(f"mutation {number}", partial(_adds_up, every))
            file.write_bytes(sound[file])
            outcome.mutations += 1
        for place in np.linspace(0, len(sound[path]) - 1, cut).astype(int).tolist():
            content = sound[path][:place]
            path.write_bytes(content)
            attempt(f"cut at {place}", partial(_arrives, sample, content, complete))
            outcome.cuts += 1
    return outcome


def _read(sample: Sample, path: Path) -> tuple[Records | InputError, Account]:
    """Return the records of a file, or why there are none, once it has been recognised or refused, too."""
    account = Account()
    with suppress(InputError):
        recognise(path)
    try:
        return sample.read(path, account), account
    except InputError as error:
        return error.as_problem(), account


def _doubt(path: Path, sample: Sample, result: Records | InputError, account: Account) -> str:
    if isinstance(result, InputError):
        return "" if result.path.startswith(str(path)) and len(result.reason) > 20 else f"says too little: {result!r}"
    told = len(account.rejections)
    most = min(account.rejected, KEPT_REJECTIONS)
    if told > most or (told < most and not (told and sample.costly)):
        return f"{account.rejected} rejected, {told} told"
    return "" if all(len(reason) > 10 for _, reason in account.rejections) else f"says too little: {account.rejections}"


def _adds_up(every: int, result: Records | InputError, account: Account) -> str:
    counted = account.accepted + account.rejected
    if isinstance(result, InputError) or every < 0 or counted == every:
        return ""
    return f"{every} records, but {account.accepted} accepted and {account.rejected} rejected"


def _arrives(sample: Sample, content: bytes, complete: Records, result: Records | InputError, account: Account) -> str:
    """Tell what is wrong with the reading of a file that was cut off."""
    whole, seam = sample.whole(content) if sample.whole else (0, True)
    if isinstance(result, InputError):
        # Navigation needs a time, which may come late.
        return "" if whole < 10 or sample.indivisible else f"{whole} whole records, but: {result}"
    # Of the last line of a text nobody can know whether its last digit is there.
    if result[:-1] != complete[: max(len(result) - 1, 0)] and sample.whole:
        return "other records than in the whole file"
    if account.accepted < whole:
        return f"{whole} whole records, {account.accepted} accepted"
    if whole and not (seam or account.truncated or account.accepted == whole + 1):
        return f"the file ends within a record, but is not called truncated: {account}"
    return ""


@contextmanager
def _bounded(outcome: Outcome) -> Iterator[None]:
    """Bound the memory of this process, and note the most that was taken.

    What the process had before beyond what a new one has (`NEW`: the interpreter and the libraries) is other tests'.
    """
    before = resource.getrlimit(resource.RLIMIT_DATA)
    others = max(_memory("VmRSS") - NEW, 0)
    ended = 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    Path("/proc/self/clear_refs").write_text("5")  # The peak is counted anew.
    resource.setrlimit(resource.RLIMIT_DATA, (_memory("VmData") + BEYOND, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)
        started, own = 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, _memory("VmHWM")
        # Until it runs its own program a process that is started counts as large as the one that starts it.
        outcome.memory = max(own - others, started if started > max(ended, own) else 0)
    if outcome.memory > MEMORY:
        outcome.failures.append(f"{outcome.memory >> 20} MB of memory")


def _memory(name: str) -> int:
    status = Path("/proc/self/status").read_text()
    return int(status.partition(f"{name}:")[2].split()[0]) * 1024
