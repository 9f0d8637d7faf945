"""`wheelprint.toml`: what may stand in it, its defaults, and its validation at the edge."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from .errors import InputError
from .quantities import QUANTITIES, TIME_QUANTITIES
from .signals import CAN_SIGNALS


class Section(BaseModel):
    """A table of the project file: unknown keys are errors, values cannot be changed afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True)


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


class Threshold(Section):
    """What one detector takes for an emergency: a number, or a table that goes by the driver.

    A number N stands for `{ at_least = N, quantile = 1 - rarity }`.
    """

    at_least: float = Field(default=0.0, ge=0, description="the threshold is never lower")
    quantile: float | None = Field(
        default=None, gt=0, lt=1, description="share of the driver's driving that is no emergency; default: 1 - rarity"
    )


Level = Annotated[Threshold, BeforeValidator(lambda v: {"at_least": v} if isinstance(v, int | float) else v)]


def _level(at_least: float, description: str, quantile: float | None = None) -> Any:
    return Field(default=Threshold(at_least=at_least, quantile=quantile), description=description)


class Events(Section):
    """`[events]`: thresholds of the detectors, at 10 Hz."""

    hard_braking: Level = _level(5.0, "m/s², deceleration")
    brake_pressure: Level = _level(80.0, "bar")
    brake_pedal: Level = _level(85.0, "% of its way")
    hard_acceleration: Level = _level(4.5, "m/s²")
    swerve_steering_speed: Level = _level(360.0, "deg/s at the steering wheel")
    # Jerks are over in tenths of a second, so that the usual share of the time would hold many times as many of them.
    swerve_lateral_jerk: Level = _level(15.0, "m/s³, rate of the lateral acceleration", 0.995)
    hard_cornering: Level = _level(6.0, "m/s², lateral acceleration")
    skid: Level = _level(10.0, "deg/s, by which the yaw rate differs from what speed and steering let expect")
    swerve_speed: float = Field(
        default=5.0, ge=0, description="m/s; slower steering is manoeuvring, neither swerving nor skidding"
    )
    leave: float = Field(default=0.7, gt=0, le=1, description="share of its threshold below which an emergency is over")
    rarity: float = Field(
        default=0.0125,
        gt=0,
        lt=1,
        description="share of a driver's driving, of five minutes at least, that one detector may call an emergency; "
        "for a driver who exceeds a threshold more often, as in racing, it rises until no more is left beyond it",
    )
    minimum_duration: float = Field(
        default=0.3, ge=0, description="s beyond the threshold; shorter excursions are ignored"
    )
    padding: float = Field(default=1.0, ge=0, description="s, added on both sides of an emergency")
    standstill: float = Field(default=1.0, ge=0, description="m/s; slower is not driving")
    reversing: float = Field(default=120.0, gt=0, le=180, description="deg between course and heading; more is reverse")
    reverse_gears: list[int] = Field(default_factory=list, description="values of `gear` that are reverse")
    navigation_accuracy: float = Field(
        default=5.0, gt=0, description="m, standard deviation of the position; worse is not to be trusted"
    )
    untrusted_status: list[int] = Field(
        default=[0, 3, 6, 7, 8],
        description="values of `nav_status` not to be trusted; default: nothing, locking and expired of NCOM, no fix, "
        "dead reckoning, manual and simulated of NMEA",
    )


class Situations(Section):
    """`[situations]`: what stretches of a drive can be tagged with, and what is proposed."""

    names: list[Annotated[str, Field(min_length=1)]] = Field(
        default=["lane keeping", "lane change", "overtaking", "intersection", "ring road", "highway"],
        description="what a stretch can be tagged with; of these, lane change, intersection and highway are proposed",
    )
    highway_speed: float = Field(default=22.0, gt=0, description="m/s; faster is proposed as highway")
    highway_duration: float = Field(default=30.0, ge=0, description="s; a shorter stretch is no highway")
    turn_angle: float = Field(default=60.0, gt=0, description="deg; a turn of more is proposed as intersection")
    turn_radius: float = Field(default=30.0, gt=0, description="m; wider is a bend of the road")
    lane_width: tuple[float, float] = Field(
        default=(2.5, 4.5), description="m; least and most lateral displacement of a lane change"
    )
    lane_change_duration: float = Field(default=8.0, gt=0, description="s; slower is no lane change")

    @field_validator("names")
    @classmethod
    def _differ(cls, names: list[str]) -> list[str]:
        if twice := sorted({name for name in names if names.count(name) > 1}):
            reason = f"named twice: {', '.join(twice)}"
            raise ValueError(reason)
        return names


Smoothing = Literal["moving average", "zero-phase", "causal"]


class Dataset(Section):
    """`[dataset]`."""

    smoothing: Smoothing = Field(
        default="moving average",
        description="moving average: centred, as in the papers; zero-phase: a parabola through the window (Savitzky "
        "and Golay), which keeps peaks; causal: the average of the samples up to now, which is late but knows nothing "
        "of the future",
    )
    smoothing_window: int = Field(
        default=5, ge=1, description="samples that one sample is smoothed over, odd unless smoothing is causal"
    )
    speed: Literal["nav", "can"] = "nav"
    folds: int = Field(default=10, ge=2, description="M of PP eq. 12")
    by: Literal["block", "recording"] = Field(
        default="block",
        description="what is dealt to the folds: as many contiguous blocks of a driver's samples, or whole recordings",
    )
    embargo: float = Field(
        default=6.0,
        ge=0,
        description="s left out of training on both sides of a test fold: at least the longest window, smoothing and "
        "the path ahead that a lookahead distance is found on included",
    )
    seed: int = 0

    @field_validator("smoothing_window")
    @classmethod
    def _is_odd(cls, window: int, info: ValidationInfo) -> int:
        if window % 2 == 0 and info.data.get("smoothing") != "causal":
            raise ValueError("a centred window needs an odd number of samples")
        return window


class Lookahead(Section):
    """`[lookahead]`: see `docs/lookahead.md`."""

    definition: Literal["paper", "refined"] = Field(
        default="paper",
        description="paper: the path point whose pure pursuit steering is nearest to the driver's (PP eq. 3); refined: "
        "between path points, steering lag undone, and continuous where the steering does not tell",
    )
    reference: str = Field(
        default="driven",
        min_length=1,
        description="the path that the goal point lies on: driven, the recorded path ahead; or a CSV or Parquet file "
        "of latitude, longitude (deg) or x, y (m from the recording's origin) in the direction of travel, from the "
        "project folder; {driver} and {recording} stand for their names",
    )
    points: int = Field(default=50, ge=1, description="N of PP eq. 3: candidate points ahead on the driven path")
    minimum: float = Field(default=2.0, ge=0, description="m, the nearest candidate")
    maximum: float = Field(default=100.0, gt=0, description="m, the farthest candidate")
    steering_noise: Literal["estimate"] | Annotated[float, Field(gt=0)] = Field(
        default="estimate",
        description="deg at the road wheels; distances whose steering is this near to the best explain the steering "
        "as well; estimate: per driver with a reference and `refined`, else 0.1",
    )
    position_noise: float = Field(
        default=0.02,
        ge=0,
        description="m across the path, of the car's and the path's positions; `refined` knows that it turns the "
        "steering towards near goal points",
    )
    steering_lag: Literal["estimate"] | Annotated[float, Field(ge=0, le=1)] = Field(
        default="estimate",
        description="s that the road wheels lag what the driver sees, undone by `refined`; estimate: per driver with a "
        "reference, else 0",
    )
    maximum_spread: float | None = Field(
        default=None,
        gt=0,
        description="share of the distance; samples of a larger spread neither train nor test the lookahead models; "
        "default: all do",
    )

    @field_validator("maximum")
    @classmethod
    def _is_beyond_the_minimum(cls, maximum: float, info: ValidationInfo) -> float:
        if maximum <= info.data.get("minimum", 0.0):
            raise ValueError("the farthest candidate must be farther than the nearest (lookahead.minimum)")
        return maximum


class Segments(Section):
    """`[segments]`."""

    neutral: float = Field(default=0.05, gt=0, description="deg per 0.1 s; a smaller course deviation is neutral")
    release: float | None = Field(
        default=None,
        ge=0,
        description="deg per 0.1 s, at most `neutral`; a bend that has begun ends below it. Default: `neutral`, as in "
        "MP, no hysteresis",
    )
    minimum_duration: float = Field(
        default=0.5, ge=0, description="s; shorter segments are merged with a neighbour. 0: none are, as in MP"
    )
    clusters: Literal["bic"] | Annotated[int, Field(ge=1)] = "bic"
    maximum_clusters: int = Field(default=6, ge=1)

    @field_validator("release")
    @classmethod
    def _is_lower(cls, release: float | None, info: ValidationInfo) -> float | None:
        if release is not None and release > info.data.get("neutral", release):
            raise ValueError("a bend cannot end above the course deviation that it begins with (segments.neutral)")
        return release


class LookaheadModel(Section):
    """`[models.lookahead]`: PP's two regressions."""

    components: list[int] = Field(
        default=[3, 6, 12], min_length=1, description="total numbers of components to evaluate; the last is trained"
    )
    regressors: list[int] = Field(
        default=[3], description="n2 of PP to evaluate: models of the velocity-based regression; the last is trained"
    )
    starts: int = Field(default=3, ge=1, description="k-means starts of every fit; the most likely one is kept")


class MotionPrimitives(Section):
    """`[models.motion_primitives]`: MP's two-level structure."""

    path_types: list[Literal[1, 3, 27]] = Field(
        default=[1, 3, 27], min_length=1, description="n1 of MP to evaluate; the last is trained"
    )
    past_steps: list[Annotated[int, Field(ge=-1)]] = Field(
        default=[1], min_length=1, description="n2 of MP to evaluate, -1: without any steering; the last is trained"
    )
    future_steps: int = Field(default=50, ge=1, description="n3 of MP")
    components: list[Annotated[int, Field(ge=1)]] = Field(
        default=[3], min_length=1, description="n4 of MP to evaluate; the last is trained"
    )
    starts: int = Field(default=1, ge=1)
    max_windows: int = Field(
        default=20_000,
        ge=1000,
        description="windows to learn from at most, evenly spread: neighbours, 0.1 s apart, are nearly equal",
    )
    inputs: list[Literal["paper", "curvature"]] = Field(
        default=["curvature", "paper"],
        min_length=1,
        description="mixtures to evaluate: paper, from course deviation and speed to the angle; curvature, from the "
        "path's curvature and lateral acceleration to the change of the angle; the last is trained",
    )
    calibrate: bool = Field(
        default=True, description="fit the mixtures' bands to blocks of the training data that are held out in turn"
    )
    baselines: list[Literal["kinematic", "ridge_curvature", "trees", "network"]] = Field(
        default=["kinematic", "ridge_curvature"],
        description="beside persistence and ridge; trees and network take minutes",
    )


class Personal(Section):
    """`[models.personal]`: models between drivers: learning curves, cross-driver matrix, identification, adaptation."""

    evaluate: bool = Field(default=False, description="make these parts of the evaluation; they need two drivers")
    train: bool = Field(
        default=False,
        description="`wheelprint train` keeps the population's models and those adapted to each driver, too; they need "
        "two drivers",
    )
    past_steps: int = Field(default=1, ge=-1, description="n2 of the steering windows")
    future_steps: int = Field(default=10, ge=1, description="n3 of the steering windows")
    components: int = Field(default=3, ge=1, description="of the steering's mixtures, population and own alike")
    lookahead_components: int = Field(default=6, ge=1, description="of the lookahead's mixtures, likewise")
    relevance: float = Field(
        default=0.5,
        gt=0,
        description="rows per channel that the population stands for in each component when it is adapted to a driver",
    )
    online_exponent: float = Field(
        default=0.6,
        gt=0.5,
        le=1.0,
        description="of `wheelprint train --continue`: 1 gives every drive the same weight for ever, less forgets "
        "early ones",
    )


class Models(Section):
    """`[models]`."""

    lookahead: LookaheadModel = LookaheadModel()
    motion_primitives: MotionPrimitives = MotionPrimitives()
    personal: Personal = Personal()
    minimum_minutes: float = Field(default=2.0, gt=0, description="a driver with less is not modelled")
    seed: int = 0
    faithful: bool = Field(
        default=False,
        description="`wheelprint evaluate --experiment` runs the papers' formulas as printed, see `docs/choices.md`",
    )


class Config(Section):
    """The whole project file."""

    vehicle: Vehicle
    layout: Layout = Layout()
    can: Can = Can()
    nav: Nav = Nav()
    sync: Sync = Sync()
    events: Events = Events()
    situations: Situations = Situations()
    dataset: Dataset = Dataset()
    lookahead: Lookahead = Lookahead()
    segments: Segments = Segments()
    models: Models = Models()

    @property
    def longest_window(self) -> int:
        """Steps from the first to the last raw sample that a window of any model, or what it is to predict, rests on.

        A motion primitive reaches from its past to its future steps, a lookahead distance to the last path point ahead.
        Behind that lies the sample that the course deviation, or a lag undone, takes; smoothing adds its own window.
        """
        primitives, personal = self.models.motion_primitives, self.models.personal
        ahead = max(
            max(*primitives.past_steps, 0) + primitives.future_steps,
            max(personal.past_steps, 0) + personal.future_steps if personal.evaluate else 0,
            self.lookahead.points,
        )
        return self._steps_back + ahead + self.dataset.smoothing_window - 1

    @property
    def _steps_back(self) -> int:
        return max(1, round(1e8 / self.sync.period)) if self.lookahead.definition == "refined" else 1


def read_config(path: Path) -> Config:
    """Read and validate a project file.

    Raises:
        InputError: The file is missing, is not TOML, or holds keys or values that are not allowed; every such key
            is named in one message.
    """
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        reason = "no such file. A project is a folder with this file; `wheelprint init` writes one"
        raise InputError(path, "", reason) from None
    except OSError as error:
        raise InputError(path, "", f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(path, f"byte {error.start}", "not UTF-8; save the file as UTF-8 text") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(path, "", f"not TOML: {error}") from None
    try:
        config = Config.model_validate(raw)
    except ValidationError as error:
        lines = [_complaint(item["loc"], item["type"], item["msg"], item.get("input")) for item in error.errors()]
        keys = ", ".join(dict.fromkeys(line.split(":", 1)[0] for line in lines))
        raise InputError(path, keys, "; ".join(dict.fromkeys(lines))) from None
    longest = config.longest_window * config.sync.period / 1e9
    if config.dataset.embargo < longest:
        raise InputError(path, "dataset.embargo", _short_embargo(config, longest))
    return config


def _short_embargo(config: Config, longest: float) -> str:
    primitives = config.models.motion_primitives
    past, future = max(*primitives.past_steps, 0), primitives.future_steps
    personal = max(config.models.personal.past_steps, 0), config.models.personal.future_steps
    longer = config.models.personal.evaluate and sum(personal) > past + future
    also = f"models.personal {personal[0]} and {personal[1]}, " if longer else ""
    return (
        f"{config.dataset.embargo:g} s is shorter than the longest window, {longest:g} s at {config.sync.rate:g} Hz, "
        f"and training windows would share samples with test windows. models.motion_primitives takes {past} past and "
        f"{future} future steps, {also}lookahead.points looks {config.lookahead.points} ahead, the course deviation 1 "
        f"back, and dataset.smoothing_window adds {config.dataset.smoothing_window - 1}. Write {longest:g} or more, or "
        "shorten these"
    )


def _complaint(location: tuple[int | str, ...], kind: str, message: str, found: Any) -> str:
    key = ".".join(
        str(part) for part in location if not str(part).startswith(("literal[", "constrained-", "function-"))
    )
    if kind == "missing":
        return f"{key}: missing; it has no default"
    if kind == "extra_forbidden":
        section: Any = Config
        for part in location[:-1]:
            if hasattr(section, "model_fields"):
                section = section.model_fields[part].annotation
            else:  # an element of a list or table
                *_, section = get_args(section) or (None,)
                section = get_args(section)[0] if get_origin(section) is Annotated else section
        known = list(section.model_fields) if hasattr(section, "model_fields") else []
        near = difflib.get_close_matches(str(location[-1]), known, n=1)
        hint = f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}"
        return f"{key}: unknown key; {hint}"
    return f"{key}: {message.removeprefix('Value error, ')}, found {found!r}"
