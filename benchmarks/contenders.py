"""Measuring contenders side by side: each in a process of its own, in turn, several times, and of each the median.

A contender is a function `module.name(*arguments)` that makes ready (imports, and a little work, so that nothing is
compiled or read for the first time) and returns the work; that is measured and returns facts about what it did.

    python -m benchmarks.contenders MODULE NAME ARGUMENTS      as JSON; prints the result as JSON
"""

from __future__ import annotations

import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any

Result = dict[str, Any]
Work = Callable[[], Result]
Contender = tuple[str, str, Sequence[Any]]
"""Module, function, arguments."""

ROOT = Path(__file__).resolve().parent.parent


def run_alone(contender: Contender, environment: Mapping[str, str] | None = None) -> Result:
    """Run a contender in a fresh process, numerical libraries on one thread.

    Returns:
        Its facts; `cpu_s`, of the process and its children; `wall_s`; `peak_mb`, the most memory that the process had,
        with everything imported.
    """
    module, name, arguments = contender
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    command = [sys.executable, "-m", "benchmarks.contenders", module, name, json.dumps(arguments, default=str)]
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, **threads, **(environment or {})}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"{module}.{name} failed:\n{done.stderr}")
    result: Result = json.loads(done.stdout.splitlines()[-1])
    return result


def compare(contenders: Mapping[str, Contender], repeats: int) -> dict[str, Result]:
    """Run contenders in turn, so often; return by name the median of each figure."""
    results: dict[str, list[Result]] = {name: [] for name in contenders}
    for _ in range(repeats):
        for name, contender in contenders.items():
            results[name].append(run_alone(contender))
            print(f"  {name}: {results[name][-1]['cpu_s']:.2f} CPU s", file=sys.stderr, flush=True)
    return {name: medians(each) for name, each in results.items()}


def medians(results: Sequence[Result]) -> Result:
    """Return the median of each number of several runs, and the last of what is no number."""
    last = results[-1]
    return {
        key: median([run[key] for run in results]) if isinstance(value, int | float) else value
        for key, value in last.items()
    }


def machine() -> Result:
    """Return what a figure depends on: processor, cores, memory, versions."""
    import numpy as np

    processor = next(
        (line.split(":", 1)[1].strip() for line in _lines("/proc/cpuinfo") if line.startswith("model name")),
        platform.processor() or platform.machine(),
    )
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    packages = (
        "numpy",
        "scipy",
        "numba",
        "pyarrow",
        "pandas",
        "scikit-learn",
        "python-can",
        "cantools",
        "asammdf",
        "gmr",
    )
    return {
        "processor": processor,
        "cores": os.cpu_count(),
        "memory_gb": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "blas": f"{blas['name']} {blas['version']}",
        "packages": {package: _version(package) for package in packages},
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except ModuleNotFoundError:
        return "not installed"


def _lines(path: str) -> list[str]:
    return Path(path).read_text(encoding="ascii", errors="replace").splitlines()


def _memory(name: str) -> float:
    return next(int(line.split()[1]) for line in _lines("/proc/self/status") if line.startswith(f"{name}:")) / 1024


def _cpu() -> float:
    uses = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(use.ru_utime + use.ru_stime for use in uses)


def measure(work: Work) -> Result:
    """Do the work and return its facts and what it took; see `run_alone`."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # The peak begins anew.
    cpu, wall = _cpu(), time.perf_counter()
    facts = work()
    return {**facts, "cpu_s": _cpu() - cpu, "wall_s": time.perf_counter() - wall, "peak_mb": _memory("VmHWM")}


if __name__ == "__main__":
    chosen = getattr(import_module(sys.argv[1]), sys.argv[2])
    print(json.dumps(measure(chosen(*json.loads(sys.argv[3])))))
