"""Draws `docs/performance.md` and its plots from `benchmarks/results.json`: `python -m benchmarks.performance_page`."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from html import escape

from benchmarks.contenders import ROOT, Result

DOCS = ROOT / "docs"
NOTE = "<!-- Drawn by benchmarks/performance_page.py from benchmarks/results.json; measure again, do not edit. -->\n"
GOALS = {
    "candump against python-can + cantools + pandas": 55.0,
    "candump against asammdf": 3.0,
    "BLF against python-can + cantools + pandas": 40.0,
}
"""Ratios that were aimed at, at least."""
MOST_OVER_WRITING = 1.7
PACKETS = 2.0
"""Million packets of NCOM per CPU second that were aimed at."""
PEAK_MB = 400
"""That a CAN log of any length was to stay below."""

NAMES = {"double": "Wheelprint, double", "single": "Wheelprint, single", "gmr": "gmr, means alone"}
"""Of contenders that predict."""
LARGE_SHARE = 0.2
"""Of a whole run; a stage that takes more needs a reason."""
REASONS = {
    "evaluate": (
        "ten folds of every driver are learnt from anew, the baselines too, and each mixture of the motion primitives "
        "once more for each block that its bands are calibrated on; what a fold learns from is limited to 20,000 "
        "evenly spread windows, so that the cost hardly grows with the hours"
    ),
    "convert": "every frame and packet is read, decoded and written, and clocks and signs are estimated",
}

Bars = Sequence[tuple[str, float, str]]
"""Name, length, and what is written behind the bar."""
Curves = Mapping[str, Sequence[tuple[float, float]]]
"""Points (x, y) of each line by its name."""


def bars(title: str, rows: Bars) -> str:
    """Return an SVG of horizontal bars; those of Wheelprint are dark."""
    width, left, line, right = 760, 250, 26, 130
    longest = max(length for _, length, _ in rows)
    height = 44 + line * len(rows)
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    drawn = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="13">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        f'<text x="10" y="22" font-weight="bold">{escape(title)}</text>',
    ]
    for number, (name, length, told) in enumerate(rows):
        y = 38 + line * number
        long = max((width - left - right) * length / longest, 1.0)
        colour = "#1f5fa8" if name.startswith("Wheelprint") else "#b5bcc6"
        drawn += [
            f'<text x="{left - 8}" y="{y + 14}" text-anchor="end">{escape(name)}</text>',
            f'<rect x="{left}" y="{y}" width="{long:.1f}" height="18" fill="{colour}"/>',
            f'<text x="{left + long + 6:.1f}" y="{y + 14}">{escape(told)}</text>',
        ]
    return "\n".join([*drawn, "</svg>"]) + "\n"


def curves(title: str, x: str, y: str, lines: Curves) -> str:
    """Return an SVG of lines over logarithmic axes; those of Wheelprint are dark."""
    width, height, left, right, top, bottom = 560, 340, 70, 150, 40, 50
    middle = height / 2
    points = [point for line in lines.values() for point in line]
    (low_x, high_x), (low_y, high_y) = ((min(values), max(values)) for values in zip(*points, strict=True))

    def place(point: tuple[float, float]) -> tuple[float, float]:
        across = math.log(point[0] / low_x) / math.log(high_x / low_x)
        up = math.log(point[1] / low_y) / math.log(high_y / low_y)
        return left + (width - left - right) * across, height - bottom - (height - top - bottom) * up

    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    drawn = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="12">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        f'<text x="10" y="22" font-size="13" font-weight="bold">{escape(title)}</text>',
        f'<path d="M{left} {top}V{height - bottom}H{width - right}" fill="none" stroke="#888888"/>',
        f'<text x="{(left + width - right) / 2}" y="{height - 10}" text-anchor="middle">{escape(x)}</text>',
        f'<text x="16" y="{middle}" text-anchor="middle" transform="rotate(-90 16 {middle})">{escape(y)}</text>',
    ]
    for value in sorted({point[0] for point in points}):
        at, _ = place((value, low_y))
        drawn.append(f'<text x="{at:.1f}" y="{height - bottom + 16}" text-anchor="middle">{value:g}</text>')
    for value in (low_y, math.sqrt(low_y * high_y), high_y):
        _, at = place((low_x, value))
        drawn.append(f'<text x="{left - 6}" y="{at + 4:.1f}" text-anchor="end">{value:.2g}</text>')
    for name, line in lines.items():
        colour = "#1f5fa8" if name.startswith("Wheelprint") else "#8c95a1"
        places = [place(point) for point in sorted(line)]
        path = " ".join(f"{across:.1f},{up:.1f}" for across, up in places)
        drawn.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>')
        drawn += [f'<circle cx="{across:.1f}" cy="{up:.1f}" r="3" fill="{colour}"/>' for across, up in places]
        across, up = places[-1]
        drawn.append(f'<text x="{across + 8:.1f}" y="{up + 4:.1f}" fill="{colour}">{escape(name)}</text>')
    return "\n".join([*drawn, "</svg>"]) + "\n"


def pages(results: Result) -> dict[str, str]:
    """Return the content of each file in `docs` by its name."""
    lines = [NOTE, "# Performance\n"]
    lines.append(
        "`make bench` measures this page: Wheelprint and other tools on the same data, in one run on one machine, each "
        "in a process of its own, in turn; of several runs the median counts. Ratios are of CPU seconds (user and "
        "system), which another machine changes less than either figure.\n"
    )
    files: dict[str, str] = {}
    for name, draw in PARTS.items():
        if name in results:
            lines += draw(results[name], files)
            lines.append(_machine(results[name]["machine"]))
    if not results:
        lines.append("Nothing has been measured yet.\n")
    return {"performance.md": "\n".join(lines).rstrip() + "\n", **files}


def _decoding(part: Result, files: dict[str, str]) -> list[str]:
    speeds = {
        "wheelprint candump": "Wheelprint, candump",
        "wheelprint blf": "Wheelprint, BLF",
        "writing alone": "writing Parquet alone",
        "asammdf mf4": "asammdf, MF4",
    } | {
        name: f"python-can + cantools, {'BLF' if ' blf ' in name else 'candump'}"
        for name in part["contenders"]
        if name.startswith("python-can") and name.endswith(_large(part))
    }
    rows = [
        (title, part["contenders"][name]["per_cpu_s"], f"{part['contenders'][name]['per_cpu_s'] / 1e6:.3f} million")
        for name, title in speeds.items()
        if name in part["contenders"]
    ]
    files["performance-decoding.svg"] = bars("CAN frames to Parquet per CPU second", rows)
    traffic = part["traffic"]
    what = f"{traffic['frames']:,} frames of {traffic['messages']} messages with {traffic['signals']} signals"
    lines = [
        "## Logs to Parquet\n",
        f"{what}, some of them multiplexed, and their DBC, from a seed; every tool writes all physical values.\n",
        "| ratio | measured | aimed at |",
        "|---|---|---|",
    ]
    for name, ratio in part["ratios"].items():
        goal = f"≥ {GOALS[name]:g}" if name in GOALS else f"≤ {MOST_OVER_WRITING:g}" if "writing" in name else ""
        lines.append(f"| {name} | {ratio:.2f} | {goal} |")
    lines += [
        "",
        "![CAN frames to Parquet per CPU second](performance-decoding.svg)\n",
        "| | frames or packets | per CPU second | wall s | peak memory |",
        "|---|---|---|---|---|",
    ]
    for name, figures in part["contenders"].items():
        count = figures.get("packets", figures.get("frames", 0))
        lines.append(
            f"| {name} | {count:,.0f} | {figures['per_cpu_s'] / 1e6:.3f} million | {figures['wall_s']:.1f} | "
            f"{figures['peak_mb']:.0f} MB |"
        )
    lines.append(
        f"\nAimed at: {PACKETS:g} million packets of NCOM per CPU second, and less than {PEAK_MB} MB for a CAN log of "
        "any length. The slow tools get samples of the log; that a frame costs them the same in two sizes is in the "
        "table of ratios. Peak memory is the whole process's, Python and its libraries included (Wheelprint's imports "
        "and what it has compiled take about 210 MB, and right after an installation some 70 MB more, since the system "
        "then has their files in memory and counts what lies around a used page). The first conversion after an "
        "installation compiles: "
        f"{part['first_conversion_cpu_s']:.0f} CPU s, once; what is compiled is kept beside the code.\n"
    )
    return lines


def _large(part: Result) -> str:
    """Return the larger size of sample, as it ends the names of contenders."""
    sizes = [name.rsplit(" ", 1)[1] for name in part["contenders"]]
    return max((size for size in sizes if size.isdigit()), key=int, default="")


def _mixtures(part: Result, files: dict[str, str]) -> list[str]:
    lines = ["## Mixtures\n", "| | Wheelprint | scikit-learn | ratio of CPU s |", "|---|---|---|---|"]
    rows: list[tuple[str, float, str]] = []
    for fit in part.get("windows", ()):
        what = f"EM, {fit['rows']:,} × {fit['channels']}, K = {fit['components']}"
        ours, other = fit["wheelprint"], fit["scikit-learn"]
        ratio = fit["ratio_per_iteration"]
        lines.append(
            f"| {what}, an iteration | {ours['s_per_iteration']:.2f} s, {ours['peak_mb']:.0f} MB | "
            f"{other['s_per_iteration']:.2f} s, {other['peak_mb']:.0f} MB | {ratio:.1f} |"
        )
        rows.append((what, ratio, f"{ratio:.1f} ×"))
        if peer := fit.get("gmr"):
            of_ours = peer["s_per_iteration"] / peer["rows"] * fit["rows"] / ours["s_per_iteration"]
            lines.append(
                f"| the same, a row of an iteration of gmr's, on {peer['rows']:,} rows | "
                f"{1e6 * ours['s_per_iteration'] / fit['rows']:.2f} µs | "
                f"gmr: {1e6 * peer['s_per_iteration'] / peer['rows']:.2f} µs | {of_ours:.1f} |"
            )
    if narrow := part.get("narrow"):
        ours, other = narrow["wheelprint"], narrow["scikit-learn"]
        what = f"{narrow['rows']:,} × 3, K = {narrow['components']}, {narrow['starts']} starts"
        starts = other["s_per_start"] * narrow["starts"]
        lines.append(f"| {what} | {ours['cpu_s']:.1f} s | {starts:.0f} s | {narrow['ratio']:.1f} |")
        rows.append((what, narrow["ratio"], f"{narrow['ratio']:.1f} ×"))
    if rows:
        files["performance-mixtures.svg"] = bars("scikit-learn's CPU seconds, in ours", rows)
        lines += ["", "![scikit-learn's CPU seconds, in ours](performance-mixtures.svg)\n"]
    if part.get("prediction"):
        lines += ["| mixture regression, 103 → 50 | rows per CPU s | one row, p99 |", "|---|---|---|"]
        one = part["prediction"]["one_row"]
        for name in ("double", "single", "gmr"):
            if figures := part["prediction"].get(name):
                last = f"{one['us_p99']:.0f} µs" if name == "double" else ""
                lines.append(f"| {NAMES[name]} | {figures['rows_per_cpu_s']:,.0f} | {last} |")
    lines.append("")
    return lines


def _prediction(part: Result, _files: dict[str, str]) -> list[str]:
    lines = ["## One prediction of an exported model\n", "| | p50 µs | p99 µs | fastest µs |", "|---|---|---|---|"]
    for row in part["calls"]:
        figures = " | ".join(f"{row[name]:.1f}" for name in ("p50", "p99", "fastest"))
        lines.append(f"| K = {row['components']}, {row['what']} | {figures} |")
    return [*lines, ""]


def _build(part: Result, _files: dict[str, str]) -> list[str]:
    took = f"{part['wall_s']:.1f} s wall, {part['cpu_s']:.1f} CPU s, {part['memory_mb']:.0f} MB"
    what = f"`wheelprint build` on {part['hours']:.1f} hours of {part['drivers']} drivers"
    return ["## Building a dataset\n", f"{what}: {took}.\n"]


def _whole(part: Result, files: dict[str, str]) -> list[str]:
    runs = part["runs"]
    took = {"Wheelprint": [(run["hours"], run["wall_s"]) for run in runs]}
    if len(runs) > 1:
        files["performance-run.svg"] = curves("wheelprint run, raw logs to report", "hours", "wall time, s", took)
    what = "Four simulated drivers: candump logs and NCOM in recordings of a quarter of an hour; `wheelprint run`"
    lines = [
        "## From raw logs to the report\n",
        f"{what} with its defaults. Peak memory is that of all processes together.\n",
        "| hours | workers | wall s | CPU s | peak memory |",
        "|---|---|---|---|---|",
    ]
    for run in runs:
        figures = f"{run['wall_s']:.0f} | {run['cpu_s']:.0f} | {run['peak_mb']:.0f} MB"
        lines.append(f"| {run['hours']:g} | {run['workers']} | {figures} |")
    lines.append("")
    if "exponent" in part:
        lines.append("![Wall time by hours](performance-run.svg)\n")
        lines.append(
            f"Wall time grows as hours^{part['exponent']:.2f}; {part['projected_hours']:g} hours would take "
            f"{part['projected_wall_s'] / 60:.0f} minutes: projected, not measured.\n"
        )
    longest = max(runs, key=lambda run: float(run["hours"]))
    shares = {stage: seconds / longest["wall_s"] for stage, seconds in longest["stages_s"].items()}
    told = ", ".join(f"{stage} {100 * share:.0f} %" for stage, share in shares.items())
    lines.append(f"Of {longest['hours']:g} hours' wall time: {told}.\n")
    for stage, share in shares.items():
        if share > LARGE_SHARE:
            lines.append(f"Why {stage} takes {100 * share:.0f} %: {REASONS.get(stage, 'not known')}.\n")
    return lines


def _scaling(part: Result, files: dict[str, str]) -> list[str]:
    lines = [
        "## How the cost grows\n",
        f"EM on {part['components'][0]['rows']:,} windows, CPU seconds an iteration.\n",
        "| components | columns | Wheelprint | scikit-learn | ratio |",
        "|---|---|---|---|---|",
    ]
    for fit in [*part["components"], *part["columns"]]:
        ours, other = (fit[name]["s_per_iteration"] for name in ("wheelprint", "scikit-learn"))
        ratio = fit["ratio_per_iteration"]
        lines.append(f"| {fit['components']} | {fit['channels']} | {ours:.3f} | {other:.3f} | {ratio:.1f} |")
    lines.append("")
    for what, x, of in (("components", "components", "components"), ("columns", "columns", "channels")):
        drawn = {
            name: [(fit[of], fit[key]["s_per_iteration"]) for fit in part[what]]
            for name, key in (("Wheelprint", "wheelprint"), ("scikit-learn", "scikit-learn"))
        }
        files[f"performance-{what}.svg"] = curves(f"EM by {x}", x, "CPU s an iteration", drawn)
        lines.append(f"![CPU seconds of an iteration by {x}](performance-{what}.svg)\n")
    return lines + [
        f"`wheelprint run`, {run['hours']:g} h, {run['workers']} worker{'s' if run['workers'] > 1 else ''}: "
        f"{run['wall_s']:.0f} s wall, {run['cpu_s']:.0f} CPU s, {run['peak_mb']:.0f} MB.\n"
        for run in part["workers"]
    ]


PARTS = {
    "decoding": _decoding,
    "whole_run": _whole,
    "mixtures": _mixtures,
    "scaling": _scaling,
    "prediction": _prediction,
    "build_ten_hours": _build,
}


def _machine(told: Mapping[str, object]) -> str:
    packages = ", ".join(f"{name} {version}" for name, version in told["packages"].items())  # type: ignore[attr-defined]
    return (
        f"<sub>{told['processor']}, {told['cores']} cores, {told['memory_gb']} GB, {told['system']}; Python "
        f"{told['python']}, BLAS {told['blas']}, {packages}. Load average {told['load_before']:.1f} before, "
        f"{told['load_after']:.1f} after.</sub>\n"
    )


def write(results: Result) -> None:
    """Write the page and its plots."""
    for name, content in pages(results).items():
        (DOCS / name).write_text(content, encoding="utf-8")


if __name__ == "__main__":
    write(json.loads((ROOT / "benchmarks" / "results.json").read_text(encoding="utf-8")))
