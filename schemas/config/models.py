"""What the project file says of models: `[models]` and the tables within."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from .section import Section


class LookaheadModel(Section):
    """`[models.lookahead]`: PP's two regressions."""

    components: list[int] = Field(
        default=[3, 6, 12], min_length=1, description="total numbers of components to evaluate; the last is trained"
    )
    regressors: list[int] = Field(
        default=[3], description="n2 of PP to evaluate: models of the velocity-based regression; the last is trained"
    )
    starts: int = Field(default=3, ge=1, description="k-means starts of every fit; the most likely one is kept")
    max_samples: int = Field(
        default=20_000,
        ge=1000,
        description="distances to learn from at most, evenly spread: neighbours, 0.1 s apart, are nearly equal",
    )


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
        default=["curvature"],
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
