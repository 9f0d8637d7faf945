"""Does the lookahead distance come back? Simulated drivers with known laws, through logs, convert and build.

    python benchmarks/lookahead_recovery.py [--seed 11] [--drivers 4] [--recordings 2] [--minutes 5] [--folder DIR]

It prints a table for each definition, and ends with 1 unless with the road's centre line as reference `refined` has,
for every driver, a median error under 10 % of the true h over samples with small spread, and a law h(v), fitted to
them, within 10 % of the true one over the speeds driven. Slower than 2 m/s is manoeuvring and not looked at.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from wheelprint import Project
from wheelprint.dataset.steering_lag import SLOWEST

Floats = NDArray[np.float64]

SMALL_SPREAD = 0.3
"""Of h."""
REQUIRED = 0.10
CENTRE_LINE = "truth/{driver}/{recording}.centre_line.parquet"
DEFINITIONS = (("paper", "driven"), ("refined", "driven"), ("paper", CENTRE_LINE), ("refined", CENTRE_LINE))


@dataclass(frozen=True, slots=True)
class Recovery:
    """How well one driver's lookahead distance came back.

    Attributes:
        driver: Name.
        share: Of the samples that have a small spread.
        error: Median |h − true| / true over them.
        error_everywhere: The same over all samples.
        bias: Median (h − true) / true over samples with small spread.
        correlation: Of h and true over them.
        law: m and s of h = base + time · v fitted to them.
        law_error: Largest |fitted − true| / true law over the speeds driven.
        built_law_error: The same of the law that `build` fitted on its way to the lag; None where it did not.
        lag: s, estimated; None where it was not.
        true_lag: s, time constants of the driver's hands and of the steering.
    """

    driver: str
    share: float
    error: float
    error_everywhere: float
    bias: float
    correlation: float
    law: tuple[float, float]
    law_error: float
    built_law_error: float | None
    lag: float | None
    true_lag: float

    @property
    def holds(self) -> bool:
        """Error and law are within `REQUIRED`."""
        return self.error < REQUIRED and self.law_error < REQUIRED


def fit_law(speed: Floats, distance: Floats, minimum: float, maximum: float) -> tuple[float, float]:
    """Fit h = base + time · v, clipped as the driver's is, robustly to relative errors; return base, m, and time, s."""
    from scipy.optimize import least_squares

    def misfit(law: Floats) -> Floats:
        relative: Floats = np.log(np.clip(law[0] + law[1] * speed, minimum, maximum) / distance)
        return relative

    base, time_ = least_squares(misfit, [5.0, 0.7], loss="soft_l1", f_scale=0.1).x
    return float(base), float(time_)


def measure(project: Path, driver: str, truth: Mapping[str, Any], facts: Mapping[str, Any]) -> Recovery:
    """Compare a driver's dataset with the truth."""
    table = Project(project).dataset(driver)
    recording = table["recording"].to_numpy(zero_copy_only=False)
    stamps = table["time"].cast(pa.int64()).to_numpy()
    true = np.full(len(table), np.nan)
    for name in np.unique(recording):
        drive = pq.read_table(
            project / "truth" / driver / f"{name}.parquet", columns=["time", "lookahead"], partitioning=None
        )
        own = recording == name
        rows = np.searchsorted(drive["time"].cast(pa.int64()).to_numpy(), stamps[own])
        true[own] = drive["lookahead"].to_numpy()[rows]
    speed, h, spread = (table[name].to_numpy() for name in ("speed", "lookahead", "lookahead_spread"))
    known = np.isfinite(h) & np.isfinite(true) & (speed > SLOWEST)
    told = known & (spread <= SMALL_SPREAD * h)
    who = truth["drivers"][driver]
    bounds = who["lookahead_minimum"], who["lookahead_maximum"]
    law = fit_law(speed[told], h[told], *bounds)
    driven = speed[known]
    meant = np.clip(who["lookahead_base"] + who["lookahead_time"] * driven, *bounds)

    def worst(base: float, time_: float) -> float:
        return float(np.max(np.abs(np.clip(base + time_ * driven, *bounds) / meant - 1)))

    built = facts["law_base_m"], facts["law_time_s"]
    relative = h / true - 1
    return Recovery(
        driver,
        float(np.mean(told)),
        float(np.median(np.abs(relative[told]))),
        float(np.median(np.abs(relative[known]))),
        float(np.median(relative[told])),
        float(np.corrcoef(h[told], true[told])[0, 1]),
        law,
        worst(*law),
        worst(*built) if built[0] is not None else None,
        facts["steering_lag_s"] if facts["steering_lag_standard_error_s"] is not None else None,
        who["steering_smoothing"] + truth["car"]["steering_lag"],
    )


def wheelprint(*arguments: str) -> None:
    """Run a command; 3 (something was lost) is what gaps in simulated logs give."""
    done = subprocess.run([sys.executable, "-m", "wheelprint", *arguments], check=False, capture_output=True, text=True)
    if done.returncode not in (0, 3):
        raise SystemExit(done.stderr)


def recover(folder: Path, definition: str, reference: str) -> list[Recovery]:
    """Build a converted campaign with a definition, and compare."""
    project = folder / "wheelprint.toml"
    text = project.read_text(encoding="utf-8").split("\n[lookahead]")[0]
    project.write_text(
        f'{text}\n[lookahead]\ndefinition = "{definition}"\nreference = "{reference}"\n', encoding="utf-8"
    )
    wheelprint("build", "--project", str(folder))
    truth = json.loads((folder / "truth" / "campaign.json").read_text(encoding="utf-8"))
    entries = Project(folder).manifest["dataset"]
    return [measure(folder, driver, truth, entries[driver]["lookahead"]) for driver in truth["drivers"]]


def main() -> int:
    """Simulate, convert, build with every definition, print, and judge the last one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for option, default in (("seed", 11), ("drivers", 4), ("recordings", 2), ("minutes", 5)):
        parser.add_argument(f"--{option}", type=int, default=default)
    parser.add_argument("--folder", type=Path, help="where the campaign is simulated; kept, and used again as it is")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = asked.folder or Path(temporary)
        if not (folder / "truth" / "campaign.json").exists():
            size = [f"--{name}={getattr(asked, name)}" for name in ("seed", "drivers", "recordings", "minutes")]
            wheelprint("simulate", "--project", str(folder), *size)
        wheelprint("convert", "--project", str(folder))
        for definition, reference in DEFINITIONS:
            start = time.perf_counter()
            found = recover(folder, definition, reference)
            path = "driven path" if reference == "driven" else "centre line"
            print(f"\n{definition}, along the {path} (build: {time.perf_counter() - start:.1f} s)")
            print(
                "driver     small spread  error  everywhere    bias  corr   law: base, time   its error "
                " build's   lag (true), s"
            )
            for r in found:
                built = "-" if r.built_law_error is None else f"{r.built_law_error:.1%}"
                lag = "-" if r.lag is None else f"{r.lag:.3f}"
                print(
                    f"{r.driver:10s} {r.share:11.1%} {r.error:7.1%} {r.error_everywhere:10.1%} {r.bias:+8.1%} "
                    f"{r.correlation:5.2f} {r.law[0]:9.2f} m {r.law[1]:5.2f} s {r.law_error:9.1%} "
                    f"{built:>8s} {lag:>8s} ({r.true_lag:.3f})"
                )
    failed = [r.driver for r in found if not r.holds]
    print(f"\nwithin {REQUIRED:.0%}: {len(found) - len(failed)} of {len(found)} drivers", *failed)
    return 1 if failed or not found else 0


if __name__ == "__main__":
    raise SystemExit(main())
