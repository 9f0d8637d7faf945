"""What the project file says of the car and of its logs: `[vehicle]`, `[layout]`, `[can]`, `[nav]`, `[sync]`."""

from __future__ import annotations

import difflib
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from ..quantities import QUANTITIES, TIME_QUANTITIES
from ..signals import CAN_SIGNALS
from .section import Section


class Vehicle(Section):
    """`[vehicle]`."""

    name: str = "unnamed vehicle"
    wheelbase: float = Field(gt=0.5, lt=20, description="m, front to rear axle")
    steering_ratio: Literal["estimate"] | Annotated[float, Field(gt=1, lt=100)] = Field(
        default="estimate", description="steering wheel angle / road wheel angle"
    )
    steering_offset: Literal["estimate"] | float = Field(
        default="estimate", description="deg, what the steering wheel angle reads when the car goes straight"
    )


class Layout(Section):
    """`[layout]`."""

    recordings: str = Field(
        default="raw/{driver}/{recording}", description="folder of a recording, from the project folder"
    )

    @field_validator("recordings")
    @classmethod
    def _has_placeholders(cls, pattern: str) -> str:
        missing = [name for name in ("{driver}", "{recording}") if pattern.count(name) != 1]
        if missing:
            reason = f"the pattern must hold {' and '.join(missing)} exactly once"
            raise ValueError(reason)
        return pattern


class DatabaseFile(Section):
    """A CAN database: a shipped name or a path, or a table that says more."""

    file: str = Field(description="shipped name or path: DBC, KCD, SYM, ARXML")
    channel: str | None = Field(default=None, description="the only bus whose frames it describes")
    j1939: bool | None = Field(
        default=None, description="its 29-bit messages are found by their PGN; default: as the database says"
    )


class CanSignal(Section):
    """Where a canonical signal comes from: `"Message.Signal"`, or a table that says more."""

    signal: str = Field(pattern=r"^[^.]+\.[^.]+$", description="Message.Signal of the database")
    sign: Literal[1, -1] = Field(default=1, description="-1 turns a signal that is positive to the right")
    scale: float | None = Field(
        default=None, description="factor to the stored unit; default: from the database's unit"
    )
    channel: str | None = Field(default=None, description="bus, where several carry the message")
    source: int | None = Field(
        default=None, ge=0, le=255, description="J1939 address of the sender, where several send the message"
    )


class Can(Section):
    """`[can]`."""

    database: list[Annotated[DatabaseFile, BeforeValidator(lambda v: {"file": v} if isinstance(v, str) else v)]] = (
        Field(
            default_factory=list,
            description="shipped names or paths: DBC, KCD, SYM, ARXML; with `channel` it stands for that bus's frames "
            "only, with `j1939 = true` (or where it says so itself) its 29-bit messages are found by PGN",
        )
    )
    signals: dict[str, Annotated[CanSignal, BeforeValidator(lambda v: {"signal": v} if isinstance(v, str) else v)]] = (
        Field(default_factory=dict, description='canonical = "Message.Signal"')
    )

    @field_validator("signals")
    @classmethod
    def _are_canonical(cls, signals: dict[str, CanSignal]) -> dict[str, CanSignal]:
        unknown = [name for name in signals if name not in CAN_SIGNALS]
        if unknown:
            reason = f"not canonical: {', '.join(unknown)}; the canonical signals of CAN are {', '.join(CAN_SIGNALS)}"
            raise ValueError(reason)
        return signals


class NavSignal(CanSignal):
    """Where a quantity of navigation comes from on the bus: `"Message.Signal"`, or a table that says more."""

    valid: str | None = Field(
        default=None,
        pattern=r"^\w+( < \d+)?$",
        description="signal of the same message that is 0 where this one says nothing; or, as `Age < 150`, below what "
        "it is where this one counts",
    )


class Column(Section):
    """Where a quantity of navigation comes from in a table: the column's name, or a table that says more."""

    column: str = Field(description="name of the column")
    unit: str | None = Field(default=None, description="its unit; default: the quantity's own")
    sign: Literal[1, -1] = Field(default=1, description="-1 turns a column of the other direction")
    scale: float | None = Field(default=None, description="factor to the quantity's own unit, instead of `unit`")


class TimeColumn(Section):
    """When the rows of a table were measured."""

    column: str = Field(description="name of the column")
    format: Literal[
        "iso8601", "iso8601-utc", "unix-s", "unix-ms", "unix-us", "unix-ns", "gps-s", "gps-ms", "gps-week-s"
    ] = Field(description="how it is written")
    week: str | None = Field(default=None, description="column of the GPS week, for `gps-week-s`")

    @model_validator(mode="after")
    def _has_week(self) -> TimeColumn:
        if (self.format == "gps-week-s") != (self.week is not None):
            raise ValueError("`week` names the column of the GPS week; it goes with the format gps-week-s, and only it")
        return self


class Nav(Section):
    """`[nav]`."""

    format: Literal["auto", "can", "columns", "csv", "kitti", "mcap", "ncom", "nmea", "xcom"] = Field(
        default="auto",
        description="the only format that navigation is taken from; auto: any file, else decoded CAN signals (`can`); "
        "`columns`: tables by `[nav.columns]`; `csv`: the text export of OxTS",
    )
    can: dict[str, Annotated[NavSignal, BeforeValidator(lambda v: {"signal": v} if isinstance(v, str) else v)]] = Field(
        default_factory=dict,
        description="navigation from decoded CAN signals; default: those of an OxTS unit where the database has them",
    )
    dead_reckoning: bool = Field(
        default=False,
        description="where a recording has no position, integrate yaw rate and speed of the bus to a path; the "
        "manifest says how far it drifts",
    )
    latency: float = Field(
        default=0.0,
        ge=-10,
        le=10,
        description="s, how late frames of `can` come after what they tell was measured; where they tell the time too, "
        "how much later than that",
    )
    files: Annotated[list[str], BeforeValidator(lambda v: [v] if isinstance(v, str) else v)] = Field(
        default_factory=list,
        description="one name (`gps*.csv`) or several, of the CSV and Parquet files of `[nav.columns]`",
    )
    separator: Literal["auto", ",", ";", "\t", "|"] = Field(
        default="auto", description="between the cells of a CSV; auto: the one that its first line has most of"
    )
    decimal: Literal[".", ","] = Field(default=".", description="decimal mark of a CSV")
    time: TimeColumn | None = Field(
        default=None,
        description="when a row was measured; formats: `iso8601` with a zone, `iso8601-utc` without, `unix-…` since "
        "1970 UTC, `gps-s` and `gps-ms` since 1980-01-06, `gps-week-s` seconds of the GPS week in column `week`",
    )
    columns: dict[str, Annotated[Column, BeforeValidator(lambda v: {"column": v} if isinstance(v, str) else v)]] = (
        Field(default_factory=dict, description="navigation from the columns of a table")
    )

    @field_validator("can", "columns")
    @classmethod
    def _are_quantities(cls, mapping: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        known = [*QUANTITIES, *(TIME_QUANTITIES if info.field_name == "can" else ())]
        if unknown := [name for name in mapping if name not in known]:
            near = {name: difflib.get_close_matches(name, known, n=1) for name in unknown}
            said = ", ".join(f"{name} (did you mean {near[name][0]}?)" if near[name] else name for name in unknown)
            reason = f"no quantity of navigation: {said}; known are {', '.join(known)}"
            raise ValueError(reason)
        return mapping

    @model_validator(mode="after")
    def _is_whole(self) -> Nav:
        parts = {"files": self.files, "time": self.time, "columns": self.columns}
        if any(parts.values()) and (missing := [f"nav.{name}" for name, part in parts.items() if not part]):
            reason = f"a table is read by nav.files, nav.time and nav.columns; missing: {', '.join(missing)}"
            raise ValueError(reason)
        return self


class Sync(Section):
    """`[sync]`."""

    rate: float = Field(default=10.0, gt=0, le=1000, description="Hz")
    max_gap: float = Field(default=0.5, gt=0, description="s; a longer gap ends a run")
    clock: Literal["estimate", "trust"] | float = Field(
        default="estimate",
        description="offset of the CAN clock: estimated, trusted to be UTC, or s (CAN stamp - UTC)",
    )

    @property
    def period(self) -> int:
        """Grid period in ns."""
        return round(1e9 / self.rate)
