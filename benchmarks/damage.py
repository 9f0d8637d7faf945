"""Read every format after 500 random mutations and 100 cuts of a file: `python -m benchmarks.damage [NAME...]`.

Each format is read in a process of its own, so that its memory is its own: `memory` is all that the process had, the
interpreter and all libraries included (about 210 MB), or one that it started. Starting asammdf takes two seconds of
computing, so that MF4 is read in its process fewer times, and as often as the others with asammdf in this one.
"""

from __future__ import annotations

import sys
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from io import BytesIO
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any
from unittest.mock import patch

from tests.ingest.damage import Outcome, damage
from tests.ingest.sample_logs import SAMPLES, Records
from wheelprint.ingest.account import Account
from wheelprint.ingest.can import mf4_process

MUTATIONS, CUTS = 500, 100
OF_COSTLY = 15, 5


class Here:
    """What `mf4` takes for the process of asammdf; the work is done at once, in this process."""

    def __init__(self, command: list[str], *, stderr: IO[bytes], **_: Any) -> None:
        self.code, output = 0, BytesIO()
        with warnings.catch_warnings(action="ignore"):
            try:
                mf4_process.write_frames(Path(command[3]), command[4], output)
            except Exception as error:  # noqa: BLE001  the process would end with it
                self.code = 1
                stderr.write(repr(error).encode())
        self.stdout = BytesIO(output.getvalue())

    def kill(self) -> None:
        """Do nothing: it has ended."""

    def wait(self) -> int:
        """Return how it ended."""
        return self.code


def read_here(name: str, path: Path, account: Account) -> Records:
    """Read as the sample of this name does, with asammdf in this process."""
    with patch("wheelprint.ingest.can.mf4.subprocess.Popen", Here):
        return SAMPLES[name].read(path, account)


HERE = {
    f"{name}, in this process": replace(sample, read=partial(read_here, name))
    for name, sample in SAMPLES.items()
    if sample.costly
}


def measure(name: str) -> Outcome:
    """Damage the sample of a format in a temporary folder."""
    sample = HERE.get(name) or SAMPLES[name]
    counts = OF_COSTLY if sample.costly and name not in HERE else (MUTATIONS, CUTS)
    with TemporaryDirectory(prefix="wheelprint-damage-") as folder:
        return damage(name, sample, *counts, Path(folder))


def main(names: list[str]) -> int:
    """Print a table of the formats named, or of all; return how many of them failed."""
    failed = 0
    print(f"{'format':32} {'mutations':>9} {'cuts':>5} {'results':>7} {'InputError':>10} {'slowest':>8} {'memory':>7}")
    for name in names or [*SAMPLES, *HERE]:
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
