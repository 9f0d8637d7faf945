"""How the cost grows: `python -m benchmarks.scaling [--rows N] [--hours H]`.

EM by components and by columns, beside scikit-learn, in CPU seconds an iteration; and `wheelprint run` with one worker
and with two. How a run grows with the hours, `whole_run` measures.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.mixtures import compare_windows, save_series
from benchmarks.whole_run import measure

COMPONENTS, SAME_COMPONENTS = (1, 3, 6, 9, 15), 9
FUTURES, SAME_FUTURE = (0, 12, 25, 50), 50
"""Samples that windows look ahead; a window has three columns for each, and three for the current one."""
ITERATIONS = 3

Result = dict[str, Any]


def mixtures(rows: int) -> Result:
    """Return fits by components, and by columns."""
    with tempfile.TemporaryDirectory(prefix="wheelprint-scaling-") as name:
        folder = Path(name)
        save_series(folder, rows)
        return {
            "components": [compare_windows(folder, rows, k, ITERATIONS, SAME_FUTURE) for k in COMPONENTS],
            "columns": [compare_windows(folder, rows, SAME_COMPONENTS, ITERATIONS, future) for future in FUTURES],
        }


def workers(hours: float) -> list[Result]:
    """Return whole runs with one worker and with two."""
    runs = []
    for count in (1, 2):
        with tempfile.TemporaryDirectory(prefix="wheelprint-scaling-") as name:
            runs.append(measure(hours, count, Path(name)))
    return runs


def main() -> int:
    """Measure, print, and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=50_000)
    parser.add_argument("--hours", type=float, default=1.0, help="of the whole runs; 0: none")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    results: Result = mixtures(arguments.rows)
    for fit in [*results["components"], *results["columns"]]:
        print(
            f"K = {fit['components']}, {fit['channels']} columns: {fit['wheelprint']['s_per_iteration']:.3f} against "
            f"{fit['scikit-learn']['s_per_iteration']:.3f} CPU s an iteration, {fit['ratio_per_iteration']:.1f} ×"
        )
    results["workers"] = workers(arguments.hours) if arguments.hours else []
    for run in results["workers"]:
        print(f"{run['hours']:g} h, {run['workers']} workers: wall {run['wall_s']:.0f} s, CPU {run['cpu_s']:.0f} s")
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
