"""How long does one prediction take, in ONNX and in C? Motion primitives, n2 = 1, n3 = 50: 106 inputs, 50 outputs.

    python benchmarks/prediction.py [--components 3 9] [--calls 500] [--rounds 20] [--minutes 40] [--optimise -O2 -O3]

A simulated driver's windows are learnt from; what is predicted are windows of theirs one at a time, and, as the worst
case of the C code, points between all components, where none of them can be left out.

On a machine that does other things the clock on the wall measures those too. So p50 and p99 are the smallest of the
rounds, of the calls during which the kernel did not give the core to somebody else (with those: beside it). C is
measured in processor time by batches of 20 calls, the smallest of the rounds again. It ends with 1 unless p99 is below
100 µs in ONNX (float64; mean, sd and domain score; one thread) and below 20 µs in C.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from wheelprint.dataset.path import course_deviation
from wheelprint.dataset.smoothing import moving_average
from wheelprint.modeling.drivers import one_thread
from wheelprint.modeling.export.c_header import c_header
from wheelprint.modeling.export.onnx_graph import Precision, onnx_model
from wheelprint.modeling.export.plain_regression import PlainRegression
from wheelprint.modeling.motion_primitives import EVERYTHING, fit_motion_primitives
from wheelprint.modeling.regression import MixtureRegression
from wheelprint.modeling.simulation.campaign import draw_campaign, drive_trip

Floats = NDArray[np.float64]

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
    for (int batch = 0, call = 0; batch < batches; batch++) {
        const double before = now();
        for (int one = 0; one < %d; one++, call++) {
            sum += wheelprint_bench_predict(inputs + (call %% rows) * WHEELPRINT_bench_INPUTS, mean, variance);
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
        values = truth[name].cast(pa.float64()).to_numpy()[at]
        return moving_average(values + noise.normal(0.0, sd, len(values)), run, 5)

    course = np.rad2deg(np.unwrap(np.deg2rad(truth["course"].to_numpy()[at] + noise.normal(0.0, 0.02, len(run)))))
    deviation = course_deviation(moving_average(course, run, 5), run)
    speed, steering = measured("speed", 0.02), measured("steering_wheel_angle", 0.3)
    centres = np.arange(PAST_STEPS + 1, len(run) - FUTURE_STEPS)[:, None]
    path = centres + np.arange(-PAST_STEPS, FUTURE_STEPS + 1)
    seen, ahead = centres + np.arange(-PAST_STEPS, 1), centres + np.arange(1, FUTURE_STEPS + 1)
    return np.concatenate([deviation[path], speed[path], steering[seen]], axis=1), steering[ahead]


def between_components(regression: MixtureRegression, rows: int) -> Floats:
    """Return inputs that all components explain about equally: found from their means by Gauss-Newton steps."""
    mixture = regression.mixture_.marginal(range(regression.n_features_in_))
    precisions = np.linalg.inv(mixture.covariances_)
    found = []
    for start in np.random.default_rng(0).dirichlet(np.ones(len(mixture.weights_)), rows) @ mixture.means_:
        x, joint = start, mixture.log_joint(start[None])[0]
        for _ in range(50):
            slopes = -np.einsum("kij,kj->ki", precisions, x - mixture.means_)
            move = np.linalg.lstsq(slopes - slopes.mean(axis=0), joint.mean() - joint, rcond=None)[0]
            for _ in range(20):  # shorter until it is better
                moved = mixture.log_joint((x + move)[None])[0]
                if np.ptp(moved) < np.ptp(joint):
                    x, joint = x + move, moved
                    break
                move = move / 2
        found.append(x)
    return np.array(found)


def percentiles(rounds: list[Floats]) -> tuple[float, float]:
    """Return the smallest p50 and p99 of the rounds."""
    return tuple(min(float(np.percentile(one, share)) for one in rounds) for share in (50, 99))  # type: ignore[return-value]


def time_onnx(session: Any, inputs: Floats, calls: int, rounds: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return p50 and p99 in µs of all calls, and of those that the kernel did not interrupt."""
    feeds = [{"inputs": row[None]} for row in inputs]
    every, own = [], []
    for _ in range(rounds):
        spent, interrupted = np.empty(calls), np.empty(calls, dtype=np.bool_)
        for call in range(calls):
            switches = resource.getrusage(resource.RUSAGE_THREAD).ru_nivcsw
            before = time.perf_counter_ns()
            session.run(None, feeds[call % len(feeds)])
            spent[call] = (time.perf_counter_ns() - before) / 1e3
            interrupted[call] = resource.getrusage(resource.RUSAGE_THREAD).ru_nivcsw > switches
        every.append(spent)
        own.append(spent[~interrupted])
    return percentiles(every), percentiles(own)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--components", type=int, nargs="+", default=[3, 9])
    parser.add_argument("--calls", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--minutes", type=float, default=40.0)
    parser.add_argument("--optimise", nargs="+", default=["-O2", "-O3"])
    chosen = parser.parse_args()
    import onnxruntime

    inputs, outputs = windows(chosen.minutes)
    path_types = np.full(len(inputs), "1-1-1")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    holds = True
    for components in chosen.components:
        with one_thread():
            primitives = fit_motion_primitives(
                inputs, outputs, path_types, n1=1, components=components, shrinkage=SHRINKAGE
            )
            regression = primitives.regressions[EVERYTHING]
            between = between_components(regression, 20)
            print(f"\nK = {len(regression.mixture_.weights_)}, {len(inputs)} windows")
            shares = [(regression.responsibilities(rows) > 1e-6).sum(axis=1).mean() for rows in (inputs, between)]
        print(f"  components with a responsibility above 1e-6: {shares[0]:.2f} in windows, {shares[1]:.2f} between")
        plain = PlainRegression.of([regression])
        sample = inputs[:: max(len(inputs) // 500, 1)]
        precisions: tuple[Precision, ...] = ("float64", "float32")
        for precision in precisions:
            for covariance in (False, True):
                model = onnx_model(plain, "bench", precision, {}, covariance=covariance).SerializeToString()
                session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
                every, own = time_onnx(session, sample.astype(precision), chosen.calls, chosen.rounds)
                print(
                    f"  ONNX {precision} {'with' if covariance else 'without'} covariance: p50 {own[0]:.1f} "
                    f"p99 {own[1]:.1f} µs; interrupted calls too: p99 {every[1]:.1f} µs"
                )
                if precision == "float64" and not covariance:
                    holds &= own[1] < LIMITS["ONNX"]
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "model.h").write_text(c_header(plain, "bench", ["Benchmark"], [], "mean and variance"))
            (Path(folder) / "bench.c").write_text(PROGRAM % (BATCH, BATCH))
            for level in chosen.optimise:
                command = ["gcc", "-std=c99", level, "-o", f"{folder}/bench", f"{folder}/bench.c", "-lm"]
                subprocess.run(command, check=True)  # noqa: S607
                for what, rows in (("windows", sample), ("between components", between)):
                    (Path(folder) / "inputs").write_bytes(np.ascontiguousarray(rows).tobytes())
                    call = [f"{folder}/bench", str(len(rows)), str(4 * chosen.calls // BATCH), f"{folder}/inputs"]
                    rounds = [
                        np.array(subprocess.run(call, check=True, capture_output=True, text=True).stdout.split(), float)
                        for _ in range(chosen.rounds)
                    ]
                    p50, p99 = percentiles(rounds)
                    print(f"  C gcc {level} {what}: processor p50 {p50:6.2f} p99 {p99:6.2f} µs")
                    holds &= p99 < LIMITS["C"] or what != "windows"
    print("\nwithin the limits" if holds else "\nNOT within the limits")
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
