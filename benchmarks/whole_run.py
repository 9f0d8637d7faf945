"""From raw logs to models, report included: `python -m benchmarks.whole_run [--hours 1 2 5 10]`.

Four simulated drivers with recordings of a quarter of an hour: candump logs of a CAN bus and NCOM files of an inertial
navigation system. `wheelprint run` does everything with its defaults. Asked of the system is what it took: wall time,
CPU time of it and its workers, and the most memory that all its processes had at once (resident, looked at every 50 ms;
what they share counts for each of them). Through the wall times of several lengths goes a power of the hours, fitted by
least squares of the logarithms; from it the time for 81 hours is *projected*, not measured.

It ends 1 where ten hours take 6 minutes or more, or 2 GB or more, or where the exponent is above 1.05.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil  # type: ignore[import-untyped]  # it ships no types

from benchmarks.build_ten_hours import watch

DRIVERS, MINUTES, SEED = 4, 15, 0
LONGEST_S, MOST_BYTES, STEEPEST = 360.0, 2_000_000_000, 1.05
PROJECTED_HOURS = 81.0

Result = dict[str, Any]


def measure(hours: float, workers: int, folder: Path) -> Result:
    """Simulate so many hours of raw logs into an empty folder and run everything on them.

    Raises:
        RuntimeError: The command failed.
    """
    recordings = round(hours * 60 / MINUTES / DRIVERS)
    wheelprint = [sys.executable, "-m", "wheelprint"]
    drives = ["--drivers", str(DRIVERS), "--recordings", str(recordings), "--minutes", str(MINUTES)]
    simulate = [*wheelprint, "simulate", "--project", str(folder), "--seed", str(SEED), *drives]
    subprocess.run(simulate, check=True, stdout=subprocess.DEVNULL)
    raw = sum(file.stat().st_size for file in (folder / "raw").rglob("*") if file.is_file())
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    with tempfile.TemporaryFile("w+") as said, tempfile.TemporaryFile("w+") as complained:
        command = [*wheelprint, "run", "--project", str(folder), "--workers", str(workers), "--json"]
        child = psutil.Popen(command, stdout=said, stderr=complained)
        memory = watch(child)
        wall = time.monotonic() - begin
        said.seek(0)
        complained.seek(0)
        if child.returncode not in (0, 3):
            raise RuntimeError(f"the command failed: {complained.read()}{said.read()}")
        stages = {name: stage["seconds"] for name, stage in json.load(said)["stages"].items()}
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "hours": recordings * DRIVERS * MINUTES / 60,
        "workers": workers or len(os.sched_getaffinity(0)),
        "raw_mb": raw / 1e6,
        "wall_s": wall,
        "cpu_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "peak_mb": memory / 1e6,
        "stages_s": {**stages, "report and starting": wall - sum(stages.values())},
        "load": os.getloadavg()[0],
    }


def scaling(runs: list[Result]) -> Result:
    """Return the exponent of the wall time in the hours, and what the power says of `PROJECTED_HOURS`."""
    hours, wall = (np.log([run[name] for run in runs]) for name in ("hours", "wall_s"))
    exponent, level = np.polyfit(hours, wall, 1)
    projected = float(np.exp(level + exponent * np.log(PROJECTED_HOURS)))
    return {"exponent": float(exponent), "projected_hours": PROJECTED_HOURS, "projected_wall_s": projected}


def main() -> int:
    """Measure, print, write the JSON, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, nargs="+", default=[1.0, 2.0, 5.0, 10.0])
    parser.add_argument("--workers", type=int, default=0, help="as of the command; 0: one for each core")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    runs = []
    for hours in arguments.hours:
        with tempfile.TemporaryDirectory(prefix="wheelprint-run-") as name:
            run = measure(hours, arguments.workers, Path(name))
        runs.append(run)
        stages = ", ".join(f"{stage} {seconds:.0f}" for stage, seconds in run["stages_s"].items())
        print(
            f"{run['hours']:g} h ({run['raw_mb']:.0f} MB), {run['workers']} workers: wall {run['wall_s']:.0f} s, CPU "
            f"{run['cpu_s']:.0f} s, {run['peak_mb']:.0f} MB; {stages}; load {run['load']:.1f}",
            flush=True,
        )
    result: Result = {"runs": runs}
    holds = all(run["peak_mb"] * 1e6 < MOST_BYTES for run in runs)
    holds &= all(run["wall_s"] < LONGEST_S for run in runs if run["hours"] <= 10.0)
    if len(runs) > 1:
        result |= scaling(runs)
        holds &= result["exponent"] <= STEEPEST
        print(
            f"wall time ~ hours^{result['exponent']:.2f}; projected, not measured, for {PROJECTED_HOURS:g} h: "
            f"{result['projected_wall_s'] / 60:.0f} minutes"
        )
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print("holds" if holds else "DOES NOT HOLD")
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
