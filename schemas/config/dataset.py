"""What the project file says of datasets: `[events]`, `[situations]`, `[dataset]`, `[lookahead]`, `[segments]`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator

from .section import Section


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
