"""Mixtures beside scikit-learn's, in one run: `python -m benchmarks.mixtures [--rows N] [--components K] [--narrow N]`.

Each contender runs in a process of its own with one BLAS thread and reports its CPU seconds and its peak memory less
that of the process before it began. The rows are windows of simulated drives, channels standardised; scikit-learn gets
them as an array, `GaussianMixture` cuts them from the series. Both make the same number of M steps from the same start
and must reach the same log-likelihood. Where `gmr` is installed it fits and predicts a sample of them, too.
"""

from __future__ import annotations

import argparse
import importlib.util
import itertools
import json
import os
import platform
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from wheelprint.modeling.estimator import RowSource
from wheelprint.modeling.mixture import GaussianMixture, Precision
from wheelprint.modeling.regression import MixtureRegression
from wheelprint.modeling.windows import Series, WindowRows, window_centres

Floats = npt.NDArray[np.float64]
Result = dict[str, Any]

FUTURE = 50
ROWS_AN_HOUR = 35_900
NARROW_STARTS = 20
ONE_ROW_CALLS = 20_000
GMR_ROWS, GMR_PREDICTIONS = 20_000, 200
"""What gmr, which takes long per row, gets to fit and to predict."""


def simulate(rows: int) -> Series:
    """Drive until there are `rows` windows; sensors' noise and smoothing as in the dataset, channels standardised."""
    from wheelprint.modeling.simulation.car import Car
    from wheelprint.modeling.simulation.driver import RATE, Driver, drive, intend
    from wheelprint.modeling.simulation.road import generate_road

    car, driver = Car(), Driver("driver")
    drives = []
    for hour in range(-(-(rows + 200) // ROWS_AN_HOUR)):
        generator = np.random.default_rng(hour)
        road = generate_road(generator, 30.0 * 3600)
        intentions = intend(generator, road, driver, (), 3600.0)
        assert intentions is not None  # noqa: S101 - only emergencies can be impossible
        motion = drive(generator, road, car, driver, intentions, 3600.0)
        every = slice(None, None, RATE // 10)
        course = np.degrees(motion.course[every])
        wheel = car.steering_ratio * np.degrees(motion.road_wheel_angle[every])
        channels = np.stack([np.diff(course, prepend=course[0]), motion.speed[every], wheel])
        channels += [[0.02], [0.02], [0.05]] * generator.standard_normal(channels.shape)
        drives.append([np.convolve(channel, np.full(5, 0.2), "valid") for channel in channels])
    values: Floats = np.concatenate(drives, axis=1)
    values = (values - values.mean(axis=1, keepdims=True)) / values.std(axis=1, keepdims=True)
    stretch = np.repeat(np.arange(len(drives)), [len(channels[0]) for channels in drives])
    none = np.zeros(len(stretch), dtype=np.int64)
    return Series(none, none, stretch, values[0], values[1], values[2], np.full(len(stretch), np.nan), none, none)


def windows_of(series: Series, rows: int, future: int) -> WindowRows:
    """Return the first `rows` windows of the series, so many samples into the future."""
    centres = window_centres(series.stretch, np.ones(len(series.stretch), dtype=np.bool_), 0, future)
    return WindowRows(series, centres[:rows], 0, future)


class Standardised(RowSource):
    """Windows whose every column has variance 1: the same regularisation then means the same to both contenders."""

    def __init__(self, source: WindowRows, mean: Floats, sd: Floats) -> None:
        self.shape, self._source, self._mean, self._sd = source.shape, source, mean, sd

    def __getitem__(self, index: slice | npt.NDArray[np.intp]) -> Floats:
        rows = self._source[index]
        rows -= self._mean
        rows /= self._sd
        return rows


def standardised(series: Series, rows: int, future: int = FUTURE) -> Standardised:
    """Return the first `rows` windows of the series, standardised by column."""
    source = windows_of(series, rows, future)
    starts = range(0, rows, 5000)
    mean = sum(source[start : start + 5000].sum(axis=0) for start in starts) / rows
    variance = sum(np.square(source[start : start + 5000] - mean).sum(axis=0) for start in starts) / rows
    return Standardised(source, mean, np.sqrt(variance))


def save_series(folder: Path, rows: int) -> None:
    """Save a series that has so many windows."""
    series = simulate(rows)
    np.savez(folder / "series.npz", **{field: getattr(series, field) for field in Series.__dataclass_fields__})


def load_series(folder: Path) -> Series:
    """Return the series that `save_series` saved."""
    stored = np.load(folder / "series.npz")
    return Series(**{name: stored[name] for name in stored.files})


def measured(work: Callable[[], Result]) -> Result:
    """Return what the work returns, and its CPU seconds and peak memory in MB."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak begins anew
    before, begin = _memory("VmRSS"), time.process_time()
    result = work()
    return {**result, "cpu_s": time.process_time() - begin, "peak_mb": _memory("VmHWM") - before}


def fit_windows(folder: Path, rows: int, iterations: int, contender: str, future: int = FUTURE) -> Result:
    """Make M steps on windows from the saved start, with scikit-learn or gmr, or in the precision named."""
    series = load_series(folder)
    start = np.load(folder / "start.npz")
    source = standardised(series, rows, future)
    if contender == "scikit-learn":
        return _fit_scikit_learn(source[:], start, iterations)
    if contender == "gmr":
        return _fit_gmr(source[:], start, iterations)
    initial = GaussianMixture.from_parameters(start["weights"], start["means"], start["covariances"])
    precision: Precision = "double" if contender == "double" else "auto"
    compiled = standardised(series, min(rows, 25_000), future)
    GaussianMixture(len(initial.weights_), max_iterations=1, precision=precision).fit(compiled, initial_mixture=initial)
    mixture = GaussianMixture(len(initial.weights_), max_iterations=iterations, tolerance=0.0, precision=precision)
    result = measured(lambda: {"fit": mixture.fit(source, initial_mixture=initial)})
    del result["fit"]
    passes = mixture.n_iterations_ + 1
    return {**result, "s_per_iteration": result["cpu_s"] / passes, "log_likelihood": mixture.log_likelihoods_[-1]}


def _fit_scikit_learn(rows: Floats, start: Any, iterations: int) -> Result:
    """Make M steps; n_iterations + 1 E steps, as the other contender makes them."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.mixture import GaussianMixture as Reference
    from sklearn.utils._testing import ignore_warnings

    reference = Reference(
        len(start["weights"]),
        max_iter=iterations,
        tol=0.0,
        reg_covar=1e-6,
        init_params="random",  # replaced by what follows; k-means would be counted
        weights_init=start["weights"],
        means_init=start["means"],
        precisions_init=_precisions(start["covariances"]),
    )
    fit = ignore_warnings(category=ConvergenceWarning)(reference.fit)
    result = measured(lambda: {"fit": fit(rows)})
    del result["fit"]
    parts = np.array_split(rows, 50)
    scores = [reference.score(part) for part in parts]
    return {
        **result,
        "s_per_iteration": result["cpu_s"] / (iterations + 1),
        "log_likelihood": float(np.average(scores, weights=[len(part) for part in parts])),
    }


def _fit_gmr(rows: Floats, start: Any, iterations: int) -> Result:
    import gmr  # type: ignore[import-not-found]  # it is installed by `make bench` alone

    mixture = gmr.GMM(len(start["weights"]), start["weights"], start["means"], start["covariances"])
    result = measured(lambda: {"fit": mixture.from_samples(rows, R_diff=0.0, n_iter=iterations)})
    del result["fit"]
    return {**result, "rows": len(rows), "s_per_iteration": result["cpu_s"] / iterations}


def _precisions(covariances: Floats) -> Floats:
    inverses = np.linalg.inv(np.linalg.cholesky(covariances))
    precisions: Floats = inverses.transpose(0, 2, 1) @ inverses
    return precisions


def narrow_rows(rows: int) -> Floats:
    """Return rows of three channels: a speed, a course deviation, and a distance that depends on both."""
    generator = np.random.default_rng(1)
    speed = generator.choice([3.0, 8.0, 14.0, 22.0], rows, p=[0.1, 0.3, 0.4, 0.2]) + generator.normal(0, 2.0, rows)
    deviation = generator.standard_t(3, rows) / np.maximum(speed, 1.0)
    distance = 4.0 + 0.7 * speed - 2.0 * np.abs(deviation) + generator.normal(0, 1.0, rows) * (1 + 0.05 * speed)
    values = np.stack([speed, deviation, distance], axis=1)
    standard: Floats = (values - values.mean(axis=0)) / values.std(axis=0)
    return standard


def fit_narrow(rows: int, components: int, starts: int, contender: str) -> Result:
    """Fit rows of three channels with several starts to scikit-learn's tolerance."""
    X = narrow_rows(rows)
    if contender == "scikit-learn":
        from sklearn.mixture import GaussianMixture as Reference

        reference = Reference(components, n_init=starts, random_state=0, max_iter=200)
        result = measured(lambda: {"fit": reference.fit(X)})
        return {**result, "fit": None, "log_likelihood": reference.score(X), "s_per_start": result["cpu_s"] / starts}
    mixture = GaussianMixture(components, n_starts=starts, tolerance=1e-3)
    GaussianMixture(1, max_iterations=1).fit(X[:100])
    result = measured(lambda: {"fit": mixture.fit(X)})
    return {**result, "fit": None, "log_likelihood": mixture.score(X), "s_per_start": result["cpu_s"] / starts}


def predict_windows(folder: Path, rows: int) -> Result:
    """Predict the steering of windows, all at once and one by one."""
    series, start = load_series(folder), np.load(folder / "start.npz")
    mixture = GaussianMixture.from_parameters(start["weights"], start["means"], start["covariances"])
    inputs = mixture.n_features_in_ - FUTURE
    regression = MixtureRegression.from_mixture(mixture, range(inputs), range(inputs, mixture.n_features_in_))
    X = standardised(series, rows)[:][:, :inputs].copy()
    result: Result = {}
    for name, single in (("double", False), ("single", True)):
        regression.predict(X[:2], return_sd=True, single=single)
        took = []
        for _ in range(5):
            begin = time.process_time()
            mean, sd = regression.predict(X, return_sd=True, single=single)
            took.append(time.process_time() - begin)
        expected = regression.predict(X[-1:], return_sd=True) if single else (mean[-1:], sd[-1:])
        error = np.abs(mean[-1] - expected[0][0]) / expected[1][0]
        result[name] = {
            "rows_per_cpu_s": len(X) / min(took),
            "error_in_sd": float(error.max()),
        }
    if importlib.util.find_spec("gmr") is not None:
        import gmr

        peer = gmr.GMM(len(mixture.weights_), mixture.weights_, mixture.means_, mixture.covariances_)
        begin = time.process_time()
        theirs = peer.predict(np.arange(inputs), X[:GMR_PREDICTIONS])
        seconds = time.process_time() - begin
        # gmr does not compute in logarithms: in so many dimensions its responsibilities may leave the range of doubles.
        same = np.isclose(regression.predict(X[:GMR_PREDICTIONS]), theirs, rtol=1e-6).all(axis=1)
        result["gmr"] = {"rows_per_cpu_s": GMR_PREDICTIONS / seconds, "share_equal_to_ours": float(same.mean())}
    return {**result, "one_row": time_one_row(regression, X)}


def time_one_row(regression: MixtureRegression, X: Floats) -> Result:
    """Predict rows one by one, five times over; medians of the percentiles, in µs.

    On the wall's clock a call takes longer where the kernel gave the core to somebody else; CPU time leaves that out.
    """
    regression.predict_one(X[0])
    rounds = []
    for _ in range(5):
        times = []
        for x in itertools.islice(itertools.cycle(X), ONE_ROW_CALLS):
            begin, begin_cpu = time.perf_counter_ns(), time.thread_time_ns()
            regression.predict_one(x)
            end_cpu = time.thread_time_ns()
            times.append((time.perf_counter_ns() - begin, end_cpu - begin_cpu))
        rounds.append(np.percentile(times, [50, 99], axis=0) / 1e3)
    wall, cpu = np.median(rounds, axis=0).T.tolist()
    return {"us_p50": wall[0], "us_p99": wall[1], "cpu_us_p50": cpu[0], "cpu_us_p99": cpu[1]}


def alone(work: Callable[..., Result], *arguments: Any) -> Result:
    """Run work in a fresh process, so that its memory is its own."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(work, *arguments).result()


def _memory(name: str) -> float:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{name}:")) / 1024


def compare_windows(folder: Path, rows: int, components: int, iterations: int, future: int = FUTURE) -> Result:
    """Return the contenders and their ratios; the start is EM on 20,000 windows."""
    series = load_series(folder)
    part = standardised(series, rows, future)[:: max(rows // 20_000, 1)]
    start = GaussianMixture(components, max_iterations=5, n_starts=1).fit(part)
    np.savez(folder / "start.npz", weights=start.weights_, means=start.means_, covariances=start.covariances_)
    ours = alone(fit_windows, folder, rows, iterations, "auto", future)
    reference = alone(fit_windows, folder, rows, iterations, "scikit-learn", future)
    others: Result = {}
    if future == FUTURE and importlib.util.find_spec("gmr") is not None:
        others["gmr"] = alone(fit_windows, folder, min(rows, GMR_ROWS), iterations, "gmr", future)
    return {
        **others,
        "rows": rows,
        "channels": part.shape[1],
        "components": len(start.weights_),
        "condition": float(np.linalg.cond(np.corrcoef(part.T))),
        "ratio_per_iteration": reference["s_per_iteration"] / ours["s_per_iteration"],
        "likelihood_difference": abs(ours["log_likelihood"] / reference["log_likelihood"] - 1.0),
        "wheelprint": ours,
        "scikit-learn": reference,
    }


def compare_narrow(rows: int, components: int, reference_starts: int) -> Result:
    """Return both contenders and their ratio; scikit-learn's time is that of a start, times the starts."""
    ours = alone(fit_narrow, rows, components, NARROW_STARTS, "wheelprint")
    reference = alone(fit_narrow, rows, components, reference_starts, "scikit-learn")
    return {
        "rows": rows,
        "components": components,
        "starts": NARROW_STARTS,
        "starts_measured_of_scikit_learn": reference_starts,
        "ratio": reference["s_per_start"] / ours["s_per_start"],
        "wheelprint": ours,
        "scikit-learn": reference,
    }


def main() -> int:
    """Print the table and write the JSON; return 1 where likelihoods differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=50_000, help="windows of 153 channels (the goal's: 500000)")
    parser.add_argument("--components", type=int, nargs="*", default=[3, 9])
    parser.add_argument("--iterations", type=int, default=3)
    parser.add_argument("--narrow", type=int, default=100_000, help="rows of 3 channels (the goal's: 1000000); 0: none")
    parser.add_argument("--narrow-starts", type=int, default=2, help=f"scikit-learn's (the goal's: {NARROW_STARTS})")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    results: Result = {"machine": platform.processor() or platform.machine(), "cores": os.cpu_count(), "threads": 1}
    wide: list[Result] = []
    with TemporaryDirectory(prefix="wheelprint-mixtures-") as name:
        folder = Path(name)
        if arguments.components:
            save_series(folder, arguments.rows)
        for components in arguments.components:
            wide.append(compare_windows(folder, arguments.rows, components, arguments.iterations))
            _print_fit(f"EM, {arguments.rows} × 153, K = {components}", wide[-1], wide[-1]["ratio_per_iteration"])
        if arguments.components:
            results["prediction"] = alone(predict_windows, folder, min(arguments.rows, 50_000))
            what, one = f"GMR 103 → 50, K = {arguments.components[-1]}", results["prediction"]["one_row"]
            for precision in ("double", "single"):
                rate = results["prediction"][precision]["rows_per_cpu_s"]
                print(f"{what}, {precision}: {rate:,.0f} rows per CPU s")
            print(f"{what}, one row: {', '.join(f'{name} {figure:.0f}' for name, figure in one.items())}")
        results["windows"] = wide
    if arguments.narrow:
        narrow = results["narrow"] = compare_narrow(arguments.narrow, 12, arguments.narrow_starts)
        _print_fit(f"{arguments.narrow} × 3, K = 12, {NARROW_STARTS} starts", narrow, narrow["ratio"])
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    return int(any(result["likelihood_difference"] > 1e-6 for result in wide))


def _print_fit(what: str, result: Result, ratio: float) -> None:
    ours, reference = result["wheelprint"], result["scikit-learn"]
    print(
        f"{ratio:5.1f} ×  {what}: {ours['cpu_s']:.2f} against {reference['cpu_s']:.2f} CPU s, "
        f"{ours['peak_mb']:.0f} against {reference['peak_mb']:.0f} MB, log-likelihood "
        f"{ours['log_likelihood']:.6f} against {reference['log_likelihood']:.6f}",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
