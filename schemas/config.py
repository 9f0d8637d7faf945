"""`wheelprint.toml`: what may stand in it, its defaults, and its validation at the edge."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, field_validator

from .errors import InputError
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


class Nav(Section):
    """`[nav]`."""

    format: Literal["auto", "kitti", "mcap", "ncom", "nmea", "oxts-csv", "xcom"] = Field(
        default="auto", description="the only format that navigation is taken from; auto: any"
    )


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


class Dataset(Section):
    """`[dataset]`."""

    smoothing_window: int = Field(default=5, ge=1, description="samples of the moving average, odd")
    speed: Literal["nav", "can"] = "nav"
    folds: int = Field(default=10, ge=2, description="M of PP eq. 12")
    embargo: float = Field(
        default=6.0,
        ge=0,
        description="s left out of training on both sides of a test fold: the longest window, smoothing included",
    )
    seed: int = 0

    @field_validator("smoothing_window")
    @classmethod
    def _is_odd(cls, window: int) -> int:
        if window % 2 == 0:
            raise ValueError("a centred moving average needs an odd number of samples")
        return window


class Lookahead(Section):
    """`[lookahead]`."""

    points: int = Field(default=50, ge=1, description="N of PP eq. 3: candidate path points ahead")
    minimum: float = Field(default=2.0, ge=0, description="m, the nearest candidate")
    maximum: float = Field(default=100.0, gt=0, description="m, the farthest candidate")
    steering_noise: float = Field(
        default=0.1,
        gt=0,
        description="deg at the road wheels; candidates this near to the best explain the steering as well",
    )


class Segments(Section):
    """`[segments]`."""

    neutral: float = Field(default=0.05, gt=0, description="deg per 0.1 s; a smaller course deviation is neutral")
    clusters: Literal["bic"] | Annotated[int, Field(ge=1)] = "bic"
    maximum_clusters: int = Field(default=6, ge=1)


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


class Models(Section):
    """`[models]`."""

    lookahead: LookaheadModel = LookaheadModel()
    motion_primitives: MotionPrimitives = MotionPrimitives()
    minimum_minutes: float = Field(default=2.0, gt=0, description="a driver with less is not modelled")
    seed: int = 0


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
        return Config.model_validate(raw)
    except ValidationError as error:
        lines = [_complaint(item["loc"], item["type"], item["msg"], item.get("input")) for item in error.errors()]
        keys = ", ".join(dict.fromkeys(line.split(":", 1)[0] for line in lines))
        raise InputError(path, keys, "; ".join(dict.fromkeys(lines))) from None


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
