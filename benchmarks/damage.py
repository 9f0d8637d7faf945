"""Read every format after 500 random mutations and 100 cuts of a file: `python -m benchmarks.damage [NAME...]`.

Each format is read in a process of its own, so that its memory is its own: `memory` is all that the process had, the
interpreter and all libraries included (about 210 MB), or one that it started. Starting asammdf takes two seconds of
computing, so that MF4 is read as users read it fewer times, and as often as the others by forks of a process in which
asammdf has started. They are what the reader starts in all else: in their bounds of memory and time, and in their end,
which some damage brings about by a segmentation fault in asammdf.
"""

from __future__ import annotations

import os
import sys
import traceback
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from signal import SIGKILL
from tempfile import TemporaryDirectory
from typing import IO, Any
from unittest.mock import patch

from tests.ingest.damage import Outcome, damage
from tests.ingest.sample_logs import SAMPLES, Records
from wheelprint.ingest.account import Account
from wheelprint.ingest.can import mf4_process

MUTATIONS, CUTS = 500, 100
OF_COSTLY = 15, 5


class Forked:
    """What `mf4` takes for the process that it starts: a fork of this one, in which asammdf is there already."""

    def __init__(self, command: list[str], *, stderr: IO[bytes], **_: Any) -> None:
        import_module("asammdf")
        output, into = os.pipe()
        self.number = os.fork()
        if self.number == 0:
            os.dup2(into, 1)
            os.dup2(stderr.fileno(), 2)
            try:
                mf4_process.main(Path(command[3]), command[4])
            except BaseException:  # noqa: BLE001  the process ends with it, as an interpreter does
                os.write(2, traceback.format_exc().encode())
                os._exit(1)
            os._exit(0)
        os.close(into)
        self.stdout = os.fdopen(output, "rb")

    def kill(self) -> None:
        """End it."""
        os.kill(self.number, SIGKILL)

    def wait(self) -> int:
        """Return how it ended: its code, or the signal, negative."""
        return os.waitstatus_to_exitcode(os.waitpid(self.number, 0)[1])


def read_forked(name: str, path: Path, account: Account) -> Records:
    """Read as the sample of this name does, with a fork of this process as that of asammdf."""
    with patch("wheelprint.ingest.can.mf4.subprocess.Popen", Forked):
        return SAMPLES[name].read(path, account)


FORKED = {
    f"{name}, forked": replace(sample, read=partial(read_forked, name))
    for name, sample in SAMPLES.items()
    if sample.costly
}


def measure(name: str) -> Outcome:
    """Damage the sample of a format in a temporary folder."""
    sample = FORKED.get(name) or SAMPLES[name]
    counts = OF_COSTLY if sample.costly and name not in FORKED else (MUTATIONS, CUTS)
    with TemporaryDirectory(prefix="wheelprint-damage-") as folder:
        return damage(name, sample, *counts, Path(folder))


def main(names: list[str]) -> int:
    """Print a table of the formats named, or of all; return how many of them failed."""
    failed = 0
    print(f"{'format':32} {'mutations':>9} {'cuts':>5} {'results':>7} {'InputError':>10} {'slowest':>8} {'memory':>7}")
    for name in names or [*SAMPLES, *FORKED]:
        with ProcessPoolExecutor(1, get_context("spawn")) as alone:
            outcome = alone.submit(measure, name).result()
        print(
            f"{name:32} {outcome.mutations:9} {outcome.cuts:5} {outcome.results:7} {outcome.refusals:10} "
            f"{outcome.slowest:6.2f} s {outcome.memory >> 20:4} MB",
            *(f"\n    {failure}" for failure in outcome.failures),
            flush=True,
        )
        failed += bool(outcome.failures)
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
