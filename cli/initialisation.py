"""`wheelprint init`: a project file to fill in."""

from __future__ import annotations

from pathlib import Path

from .output import Report
from .schemas.errors import InputError

TEMPLATE = """\
# Wheelprint project. What stands behind # is the default; every key is explained in docs/configuration.md.

[vehicle]
name = "BYD Tang"
wheelbase = 2.82                # m
# steering_ratio = "estimate"   # or a number: steering wheel angle / road wheel angle
# steering_offset = "estimate"  # or deg: what the steering wheel angle reads when the car goes straight

[layout]
# recordings = "raw/{driver}/{recording}"

[can]
database = ["byd_tang"]         # shipped name or path: DBC, KCD, SYM, ARXML

[can.signals]                   # canonical = "Message.Signal", or a table with sign, scale, channel
steering_wheel_angle = "STEER.ANGLE"
speed = "MOTION.Speed"
# yaw_rate = { signal = "Message.Signal", sign = -1 }   # a signal that is positive to the right

[sync]
# rate = 10.0                   # Hz
# max_gap = 0.5                 # s; a longer gap ends a run
# clock = "estimate"            # or "trust", or the CAN clock's offset in s

[dataset]
# smoothing = "moving average"  # or "zero-phase", or "causal": knows nothing of the future
# smoothing_window = 5          # samples
# folds = 10
# by = "block"                  # or "recording": folds of whole recordings
"""


def write_project(report: Report, directory: Path) -> None:
    """Write `wheelprint.toml` and `raw/` into a folder.

    Raises:
        InputError: The folder has a project file already; it is left as it is.
    """
    path = directory / "wheelprint.toml"
    if path.exists():
        raise InputError(path, "", "is there already and is left as it is; remove it first if you want a new one")
    (directory / "raw").mkdir(parents=True, exist_ok=True)
    path.write_text(TEMPLATE, encoding="utf-8")
    rows = [
        ("wheelprint.toml", "say what the vehicle is and which CAN signals to take"),
        ("raw/<driver>/<recording>/", "put each recording's CAN log and navigation log here"),
        ("wheelprint run", "then do everything"),
    ]
    report.tables.append(("Next", ("where", "what"), list(rows)))
