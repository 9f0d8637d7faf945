"""The Arrow schema of every stored table, and the columns of every stored CSV."""

from __future__ import annotations

import pyarrow as pa

from .signals import CAN_SIGNALS, NAV_SIGNALS, SIGNALS, Signal

TIME = pa.timestamp("ns", tz="UTC")


def field(name: str, kind: pa.DataType, unit: str, description: str, vss: str = "") -> pa.Field:
    """Return an Arrow field that carries its unit, description and VSS path as metadata."""
    metadata = {"unit": unit, "description": description, **({"vss": vss} if vss else {})}
    return pa.field(name, kind, metadata=metadata)


def _signal_field(signal: Signal) -> pa.Field:
    kind = pa.int16() if signal.resampling == "hold" and signal.unit == "" else pa.float64()
    return field(signal.name, kind, signal.unit, signal.description, signal.vss)


FRAMES = pa.schema(
    [
        field("time", TIME, "", "stamp of the frame"),
        field("channel", pa.string(), "", "bus the frame was seen on"),
        field("id", pa.uint32(), "", "identifier"),
        field("extended", pa.bool_(), "", "29-bit identifier"),
        field("fd", pa.bool_(), "", "CAN FD frame"),
        field("kind", pa.string(), "", "data, remote or error"),
        field("data", pa.binary(), "", "payload"),
    ]
)
"""Raw CAN frames, as `wheelprint.read_frames` returns them."""

NAVIGATION = pa.schema(
    [field("time", TIME, "", "when it was measured"), *(_signal_field(SIGNALS[name]) for name in NAV_SIGNALS)]
)
"""Navigation at its own rate, as `wheelprint.read_nav` returns it; metadata `origin`: latitude, longitude, altitude."""

CAMERA_FRAMES = pa.schema(
    [
        field("time", TIME, "", "when the frame was taken, by the camera's own stamp"),
        field("camera", pa.string(), "", "folder of images, index file or topic, relative to the recording's folder"),
        field("path", pa.string(), "", "image or MCAP file, relative to the recording's folder; null where not known"),
        field("offset", pa.int64(), "", "byte of the MCAP record, or of the chunk that holds it; null elsewhere"),
    ]
)
"""When a recording's cameras took their frames, and where each one stands; the frames are never copied."""

SYNCED = pa.schema(
    [
        field("time", TIME, "", "grid time, an exact multiple of the period"),
        field("run", pa.int32(), "", "number of the stretch without gaps; null inside a gap"),
        *(_signal_field(SIGNALS[name]) for name in (*CAN_SIGNALS, *NAV_SIGNALS)),
    ]
)
"""One recording on the common grid; every canonical column is there, null where the recording has no such signal."""

DATASET = pa.schema(
    [
        field("time", TIME, "", "grid time"),
        field("run", pa.int32(), "", "number of the stretch without gaps, within the recording"),
        field("x", pa.float64(), "m", "east of the recording's origin, smoothed"),
        field("y", pa.float64(), "m", "north of the recording's origin, smoothed"),
        field("course", pa.float64(), "deg", "direction of travel, anticlockwise from east, smoothed"),
        field("heading", pa.float64(), "deg", "where the car points, anticlockwise from east, smoothed"),
        field(
            "course_deviation",
            pa.float64(),
            "deg",
            "change of course since the previous sample, positive left",
        ),
        field("speed", pa.float64(), "m/s", "speed, smoothed"),
        field("steering_wheel_angle", pa.float64(), "deg", "zero offset removed, positive left, smoothed"),
        field("road_wheel_angle", pa.float64(), "deg", "steering wheel angle over the steering ratio"),
        field("lookahead", pa.float64(), "m", "lookahead distance of pure pursuit; null where undefined"),
        field("lookahead_spread", pa.float64(), "m", "range of lookahead distances that explain the steering"),
        field("segment", pa.int32(), "", "path segment, within the recording"),
        field("path_side", pa.string(), "", "left, right or neutral"),
        field("path_label", pa.int16(), "", "cluster of the segment, from 1"),
        field("path_type", pa.string(), "", "previous, own and next label"),
        field("situation", pa.string(), "", "driving situation of `situations.csv`; null where nothing says"),
        field("fold", pa.int16(), "", "cross-validation group, from 0"),
    ]
)
"""What models are trained on: one recording, rows of rejected events absent."""

EVENT_COLUMNS = ("recording", "start", "stop", "kind", "severity", "decision", "decided_by", "note", "decided_at")
SITUATION_COLUMNS = ("recording", "start", "stop", "situation", "decision", "decided_by", "decided_at", "note")

LOOKAHEAD_COLUMNS = (
    "driver", "model", "components", "regressors", "fold", "split", "mean_error", "mean_sd", "samples",
)  # fmt: skip
MOTION_PRIMITIVE_COLUMNS = (
    "driver", "model", "path_types", "past_steps", "future_steps", "components", "fold",
    "mean_error", "mean_variance", "coverage_68", "coverage_95", "crps", "samples",
)  # fmt: skip
LEARNING_CURVE_COLUMNS = (
    "driver", "quantity", "model", "minutes", "fold", "mean_error", "log_likelihood", "samples",
)  # fmt: skip
CROSS_DRIVER_COLUMNS = (
    "quantity", "model", "model_driver", "driver", "fold", "mean_error", "log_likelihood", "samples",
)  # fmt: skip
IDENTIFICATION_COLUMNS = (
    "driver", "fold", "minute", "model", "density", "evidence", "named", "margin", "samples",
)  # fmt: skip
HORIZON_COLUMNS = (
    "driver", "model", "path_types", "past_steps", "future_steps", "components", "fold", "horizon",
    "mean_error", "bias", "mean_variance", "coverage_68", "coverage_95", "crps", "samples",
)  # fmt: skip
"""One horizon, in s, of what `results/motion_primitives.csv` says over all of them."""
CALIBRATION_COLUMNS = (
    "driver", "model", "path_types", "past_steps", "future_steps", "components", "fold", "probability", "share",
)  # fmt: skip
"""Share of the probability integral transforms in the bin that begins at `probability`."""
TRACK_COLUMNS = (
    "driver", "path", "offset", "law", "control", "tracking_rms", "tracking_95", "tracking_max", "steering_rate_rms",
    "steering_change_rms", "steering_error", "lookahead_error", "taken_over", "distance", "seconds",
)  # fmt: skip
"""Drives of closed loops (`modeling/tracking.py`): m, deg/s, deg/s², deg, a share, s; empty where nobody knows."""
