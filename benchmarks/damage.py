"""Read every format after 500 random mutations and 100 cuts of a file: `python -m benchmarks.damage [NAME...]`.

Each format is read in a process of its own, so that its memory is its own: `memory` is all that the process had, the
interpreter and all libraries included (about 210 MB), or one that it started.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.ingest.damage import Outcome, damage
from tests.ingest.sample_logs import SAMPLES

MUTATIONS, CUTS = 500, 100


def measure(name: str) -> Outcome:
    """Damage the sample of a format in a temporary folder."""
    with TemporaryDirectory(prefix="wheelprint-damage-") as folder:
        return damage(name, MUTATIONS, CUTS, Path(folder))


def main(names: list[str]) -> int:
    """Print a table of the formats named, or of all; return how many of them failed."""
    failed = 0
    print(f"{'format':26} {'mutations':>9} {'cuts':>5} {'results':>7} {'InputError':>10} {'slowest':>8} {'memory':>7}")
    for name in names or SAMPLES:
        with ProcessPoolExecutor(1, get_context("spawn")) as alone:
            outcome = alone.submit(measure, name).result()
        print(
            f"{name:26} {outcome.mutations:9} {outcome.cuts:5} {outcome.results:7} {outcome.refusals:10} "
            f"{outcome.slowest:6.2f} s {outcome.memory >> 20:4} MB",
            *(f"\n    {failure}" for failure in outcome.failures),
            flush=True,
        )
        failed += bool(outcome.failures)
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
