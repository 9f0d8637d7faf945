"""How long does one prediction take, in ONNX and in C? Motion primitives, n2 = 1, n3 = 50: 106 inputs, 50 outputs.

The mixture is the papers', of course deviation, speed and angle; and the one that `wheelprint train` fits by default,
in coordinates of the curvature, to be computed from the same inputs.

    python benchmarks/prediction.py [--components 3 9] [--inputs 500] [--rounds 20] [--minutes 40] [--optimise O2 O3]

A simulated driver's windows are learnt from, and windows of theirs are predicted, one at a time, over and over. C is
also measured with no component left out, its worst case.

On a machine that does other things a clock measures those too. So of every figure the smallest of the rounds is taken:

    p50, p99    over the calls of a round; ONNX by the clock on the wall, without calls during which the kernel gave
                the core to somebody else; C in processor time, by batches of 20 calls
    fastest     p99 over the inputs of each input's fastest call (ONNX) or batch (C): what the program itself takes

Beside ONNX a loop is measured that takes as long whatever it is given: its p99 is the machine's alone.

It ends with 1 unless p99 is below 100 µs in ONNX (float64; mean, sd and domain score; one thread) and 20 µs in C.
"""

from __future__ import annotations

import argparse
import itertools
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from wheelprint.dataset.path import course_deviation
from wheelprint.dataset.smoothing import smooth
from wheelprint.modeling.curvature_primitives import fit_curvature_primitives
from wheelprint.modeling.drivers import one_thread
from wheelprint.modeling.export.c_header import NEGLIGIBLE, c_header
from wheelprint.modeling.export.onnx_graph import Precision, onnx_model
from wheelprint.modeling.export.plain_regression import PlainRegression
from wheelprint.modeling.motion_primitives import EVERYTHING, fit_motion_primitives
from wheelprint.modeling.simulation.campaign import draw_campaign, drive_trip

Floats = NDArray[np.float64]
Call = dict[str, Any]

PAST_STEPS, FUTURE_STEPS = 1, 50
SHRINKAGE = 30.0
"""About what cross-validation chooses for ten minutes of a simulated driver."""
LIMITS = {"ONNX": 100.0, "C": 20.0}
"""µs, p99."""
BATCH = 20

PROGRAM = """
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "model.h"
static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}
int main(int argc, char **argv) {
    const int rows = atoi(argv[1]), batches = atoi(argv[2]);
    double *inputs = malloc(sizeof(double) * (size_t)(rows * WHEELPRINT_bench_INPUTS));
    double mean[WHEELPRINT_bench_OUTPUTS], variance[WHEELPRINT_bench_OUTPUTS], sum = 0.0;
    FILE *file = fopen(argv[argc - 1], "rb");
    if (fread(inputs, sizeof(double), (size_t)(rows * WHEELPRINT_bench_INPUTS), file) == 0) return 1;
    for (int batch = 0; batch < batches; batch++) {
        const double before = now();
        for (int one = 0; one < %d; one++) {
            sum += wheelprint_bench_predict(inputs + (batch %% rows) * WHEELPRINT_bench_INPUTS, mean, variance);
            sum += mean[0] + variance[0];
        }
        printf("%%.4f\\n", (now() - before) / %d);
    }
    fprintf(stderr, "%%g\\n", sum);
    return 0;
}
"""


def windows(minutes: float) -> tuple[Floats, Floats]:
    """Return inputs and outputs of every window of a simulated drive, as the dataset would have it."""
    campaign = draw_campaign(seed=3, drivers=1, recordings=1, minutes=minutes)
    truth = drive_trip(Path(), campaign, 0).truth
    at = slice(None, None, 10)
    run = np.zeros(len(truth["time"].to_numpy()[at]), dtype=np.int32)
    noise = np.random.default_rng(0)

    def measured(name: str, sd: float) -> Floats:
        values: Floats = truth[name].cast(pa.float64()).to_numpy()[at]
        return smooth(values + noise.normal(0.0, sd, len(values)), run, 5)

    course = np.rad2deg(np.unwrap(np.deg2rad(truth["course"].to_numpy()[at] + noise.normal(0.0, 0.02, len(run)))))
    deviation = course_deviation(smooth(course, run, 5), run)
    speed, steering = measured("speed", 0.02), measured("steering_wheel_angle", 0.3)
    centres = np.arange(PAST_STEPS + 1, len(run) - FUTURE_STEPS)[:, None]
    path = centres + np.arange(-PAST_STEPS, FUTURE_STEPS + 1)
    seen, ahead = centres + np.arange(-PAST_STEPS, 1), centres + np.arange(1, FUTURE_STEPS + 1)
    return np.concatenate([deviation[path], speed[path], steering[seen]], axis=1), steering[ahead]


def time_calls(calls: Sequence[Callable[[], object]], rounds: int) -> Floats:
    """Return the µs of every round and call (rounds, n_calls); NaN where the kernel interrupted the call."""
    took = np.full((rounds, len(calls)), np.nan)
    for one in range(rounds):
        for place, call in enumerate(calls):
            switches = resource.getrusage(resource.RUSAGE_THREAD).ru_nivcsw
            before = time.perf_counter_ns()
            call()
            spent = (time.perf_counter_ns() - before) / 1e3
            if resource.getrusage(resource.RUSAGE_THREAD).ru_nivcsw == switches:
                took[one, place] = spent
    return took


def loop_of(microseconds: float) -> Callable[[], object]:
    """Return a call that always takes about as long: what its times differ by is the machine's."""
    long = 20_000
    before = time.perf_counter_ns()
    sum(range(long))
    return partial(sum, range(round(microseconds * long / ((time.perf_counter_ns() - before) / 1e3))))


def time_c(header: str, inputs: Floats, rounds: int, level: str) -> Floats:
    """Return the µs of a call for every round and input (rounds, n_inputs), by batches of calls with one input."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "model.h").write_text(header, encoding="utf-8")
        (Path(folder) / "bench.c").write_text(PROGRAM % (BATCH, BATCH), encoding="utf-8")
        (Path(folder) / "inputs").write_bytes(np.ascontiguousarray(inputs).tobytes())
        program, rows = f"{folder}/bench", str(len(inputs))
        subprocess.run(["gcc", "-std=c99", f"-{level}", "-o", program, f"{folder}/bench.c", "-lm"], check=True)  # noqa: S607
        command = [program, rows, rows, f"{folder}/inputs"]
        return np.array(
            [
                np.array(subprocess.run(command, check=True, capture_output=True).stdout.split(), dtype=float)
                for _ in range(rounds)
            ]
        )


def figures(components: str, what: str, took: Floats, limit: float | None) -> Call:
    """Print and return the figures of a measurement (rounds, n_inputs) in µs."""
    p50, p99 = (float(np.nanpercentile(took, share, axis=1).min()) for share in (50, 99))
    fastest = float(np.nanpercentile(np.nanmin(took, axis=0), 99))
    print(f"  {what:<36} p50 {p50:6.1f}   p99 {p99:6.1f}   fastest {fastest:6.1f} µs", flush=True)
    return {"components": components, "what": what, "p50": p50, "p99": p99, "fastest": fastest, "limit": limit}


def measure(plain: PlainRegression, sample: Floats, components: str, rounds: int, levels: Sequence[str]) -> list[Call]:
    """Measure one regression, print and return the calls; see `run`."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    precisions: tuple[Precision, ...] = ("float64", "float32")
    calls: list[Call] = []
    for precision in precisions:
        for covariance in (False, True):
            model = onnx_model(plain, "bench", precision, {}, covariance=covariance).SerializeToString()
            session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
            rows = sample.astype(precision)
            took = time_calls([partial(session.run, None, {"inputs": row[None]}) for row in rows], rounds)
            limit = LIMITS["ONNX"] if precision == "float64" and not covariance else None
            calls.append(
                figures(components, f"ONNX {precision}{', with covariance' if covariance else ''}", took, limit)
            )
            if limit is not None:
                took = time_calls([loop_of(calls[-1]["p50"])] * len(sample), rounds)
                calls.append(figures(components, "a loop of as long", took, None))
    header = c_header(plain, "bench", ["Benchmark"], [], "mean and variance")
    everything = header.replace(f"best - {NEGLIGIBLE}", "best - 1e300").replace(f"> -{NEGLIGIBLE} ?", "> -1e300 ?")
    for level in levels:
        calls.append(figures(components, f"C, gcc -{level}", time_c(header, sample, rounds, level), LIMITS["C"]))
        took = time_c(everything, sample, rounds, level)
        calls.append(figures(components, f"C, gcc -{level}, nothing left out", took, None))
    return calls


def run(
    components: Sequence[int] = (3, 9),
    inputs: int = 500,
    rounds: int = 20,
    minutes: float = 40.0,
    levels: Sequence[str] = ("O2", "O3"),
) -> dict[str, list[Call]]:
    """Measure; return `calls`: what was called with how many components, its figures in µs, and the limit of p99."""
    given, outputs = windows(minutes)
    path_types = np.full(len(given), "1-1-1")
    sample = given[np.linspace(0, len(given) - 1, inputs).astype(int)]
    calls: list[Call] = []
    centres = np.arange(len(given))
    for wanted, curved in itertools.product(components, (False, True)):
        with one_thread():
            if curved:
                learnt, _ = fit_curvature_primitives(
                    given, outputs, path_types, centres, n1=1, components=wanted, past_steps=PAST_STEPS, step=0.1
                )
            else:
                learnt = fit_motion_primitives(given, outputs, path_types, n1=1, components=wanted, shrinkage=SHRINKAGE)
        regression = learnt.regressions[EVERYTHING]
        k = len(regression.mixture_.weights_)
        print(f"\nK = {k}{', curvature' if curved else ''}, learnt from {len(given)} windows")
        plain = PlainRegression.of([regression], coordinates=learnt.coordinates)
        calls += measure(plain, sample, f"{k}{', curvature' if curved else ''}", rounds, levels)
    return {"calls": calls}


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--components", type=int, nargs="+", default=[3, 9])
    parser.add_argument("--inputs", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--minutes", type=float, default=40.0)
    parser.add_argument("--optimise", nargs="+", default=["O2", "O3"])
    chosen = parser.parse_args()
    calls = run(chosen.components, chosen.inputs, chosen.rounds, chosen.minutes, chosen.optimise)["calls"]
    holds = all(call["limit"] is None or call["p99"] < call["limit"] for call in calls)
    print("\nwithin the limits" if holds else "\nNOT within the limits")
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
