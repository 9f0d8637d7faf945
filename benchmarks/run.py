"""All benchmarks, side by side with other tools: `make bench`, or `python -m benchmarks.run [--only PART…] [--long]`.

Each part replaces its own figures in `benchmarks/results.json`; then `docs/performance.md` and its plots are drawn
anew. A part tells the machine, its versions and how busy it was. With `--quick` a few ratios are taken on little data
and compared with `benchmarks/expected_ratios.json`: 1 is returned where one has fallen by a third, nothing is written.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks import build_ten_hours, decoding, performance_page, prediction
from benchmarks.contenders import ROOT, Result, machine

RESULTS = ROOT / "benchmarks" / "results.json"
EXPECTED = ROOT / "benchmarks" / "expected_ratios.json"
FALLEN = 2 / 3
"""A ratio below this share of the expected one has fallen."""


def results_of(module: str, *options: str) -> Result:
    """Run a benchmark that writes its results as JSON, and return them; its own verdict does not matter here."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "results.json"
        subprocess.run([sys.executable, "-m", module, *options, "--json", str(path)], cwd=ROOT, check=False)
        results: Result = json.loads(path.read_text(encoding="utf-8"))
    return results


def parts(*, long: bool) -> dict[str, Callable[[], Result]]:
    """Return the parts by name, in the order of the page."""
    goal = ("--rows", "500000", "--iterations", "12", "--narrow", "1000000", "--narrow-starts", "1")
    return {
        "decoding": lambda: decoding.run(long_frames=decoding.LONG_FRAMES if long else 0),
        "mixtures": lambda: results_of("benchmarks.mixtures", *(goal if long else ())),
        "scaling": lambda: results_of("benchmarks.scaling"),
        "prediction": prediction.run,
        "build_ten_hours": build_ten_hours.run,
        "whole_run": lambda: results_of("benchmarks.whole_run"),
    }


def quick() -> dict[str, float]:
    """Return a few ratios on little data."""
    peers = ("candump", "blf", "ncom")
    decoded = decoding.run(
        frames=300_000, packets=200_000, samples=(20_000,), repeats=3, peers=peers, compilation=False
    )
    fitted = results_of(
        "benchmarks.mixtures", "--rows", "20000", "--components", "3", "--iterations", "2", "--narrow", "0"
    )
    return {name: ratio for name, ratio in decoded["ratios"].items() if "against" in name} | {
        "EM, 20 000 × 153, K = 3, against scikit-learn": fitted["windows"][0]["ratio_per_iteration"]
    }


def fallen(ratios: dict[str, float], expected: dict[str, float]) -> list[str]:
    """Return what to say of each ratio that has fallen by a third, and of each that was not measured."""
    said = [
        f"{name}: {ratios[name]:.1f} ×, of {usual:.1f} × expected"
        for name, usual in expected.items()
        if name in ratios and ratios[name] < FALLEN * usual
    ]
    return said + [f"{name}: not measured" for name in expected if name not in ratios]


def main() -> int:
    """Measure and write, or compare; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", metavar="PART", help="decoding, mixtures, prediction, build_ten_hours, …")
    parser.add_argument("--long", action="store_true", help="50 million frames and mixtures of the goal's size, too")
    parser.add_argument("--quick", action="store_true", help="compare a few ratios with what they should be")
    parser.add_argument("--expect", action="store_true", help="with --quick: what is measured is what they should be")
    arguments = parser.parse_args()
    if arguments.quick:
        ratios = quick()
        for name, ratio in ratios.items():
            print(f"{ratio:7.1f} ×  {name}")
        if arguments.expect:
            EXPECTED.write_text(json.dumps(ratios, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        complaints = fallen(ratios, json.loads(EXPECTED.read_text(encoding="utf-8")))
        for complaint in complaints:
            print(f"FALLEN  {complaint}")
        return int(bool(complaints))
    results: Result = json.loads(RESULTS.read_text(encoding="utf-8"))
    chosen = parts(long=arguments.long)
    if unknown := set(arguments.only or ()) - set(chosen):
        parser.error(f"no such part: {', '.join(sorted(unknown))}; there are {', '.join(chosen)}")
    for name, part in chosen.items():
        if arguments.only and name not in arguments.only:
            continue
        print(f"{name} …", flush=True)
        busy = os.getloadavg()[0]
        measured = part()
        told = machine() | {"load_before": busy, "load_after": os.getloadavg()[0]}
        results[name] = {**measured, "machine": told}
        RESULTS.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    performance_page.write(results)
    return 0


if __name__ == "__main__":
    sys.exit(main())
