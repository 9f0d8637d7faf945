"""Which models a project exports, into which files, and the model card that goes beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ... import __version__
from ...schemas.errors import InputError
from ...schemas.project import Project, encode_name
from ...schemas.store import publish, publish_json
from ..estimator import FloatArray
from ..lookahead_models import GeneralLookahead, VelocityLookahead
from ..motion_primitives import EVERYTHING, MotionPrimitives
from ..personal_models import KINDS as PERSONAL
from ..personal_models import PersonalModel
from ..predict import MODEL, SteeringModel
from ..regression import MixtureRegression
from ..storage import GOLDEN, load_model
from .c_header import c_header, c_identifier
from .onnx_graph import Precision, onnx_model
from .plain_regression import PlainRegression, domain_score

Form = Literal["onnx", "c"]
PRECISIONS: tuple[Precision, ...] = ("float64", "float32")

HOW_TO_CHOOSE = (
    "Each file is one motion primitive. Of a path type `previous-own-next` take the file of that name; where there is "
    "none, the file of its own label (the middle one); where there is none either, `all`."
)


@dataclass(frozen=True, slots=True)
class ExportedRegression:
    """One regression of a trained model, and what it predicts for its golden inputs.

    Attributes:
        name: Of a motion primitive (`1-3-2`, `3`, `all`); empty for a model of one regression.
        plain: Its arrays.
        inputs: Golden inputs (n_rows, n_inputs), in the units of `input_channels`.
        mean: (n_rows, n_outputs), deg of steering, m of lookahead.
        sd: (n_rows, n_outputs), deg or m.
        domain_score: (n_rows,), nats.
    """

    name: str
    plain: PlainRegression
    inputs: FloatArray
    mean: FloatArray
    sd: FloatArray
    domain_score: FloatArray


def export_models(project: Project, folder: Path, driver: str | None, form: Form) -> Iterator[Path]:
    """Export the trained models, a file for each regression and a card for each model.

    `onnx` writes `<model>.<driver>[.<regression>].float64.onnx` and `….float32.onnx`, and the same with the covariance
    as one more output, `….covariance.float64.onnx` and `….covariance.float32.onnx`; `c` writes `….h`. The card is
    `<model>.<driver>.<form>.json`: the model's own card, what each input is, the files, and golden vectors that a
    program can be checked by.

    Args:
        project: Its models are trained.
        folder: Where the files go.
        driver: Only this driver's models; None: all.
        form: See above.

    Yields:
        Each file written.

    Raises:
        InputError: A model is damaged or of a kind that has no export, or the extra `onnx` is not installed.
    """
    if form == "onnx":
        _require_onnx()
    for name in sorted(project.manifest.get("models", {})):
        kind, _, whose = name.partition("/")
        if driver not in (None, whose):
            continue
        model_folder = project.model_folder(kind, whose)
        model, card = load_model(model_folder, KINDS)
        with np.load(model_folder / GOLDEN, allow_pickle=False) as golden:
            inputs = golden["input_0"]
        stem = f"{kind}.{encode_name(whose)}"
        regressions = exported_regressions(model, inputs)
        channels = input_channels(model)
        files = {}
        for one in regressions:
            place = f"{stem}.{one.name}" if one.name else stem
            identifier = "_".join([kind, c_identifier(whose), *filter(None, one.name.split("-"))])
            content = _contents(one, card, identifier, place, channels, form)
            files[one.name or EVERYTHING] = list(content)
            for file, data in content.items():
                with publish(folder / file) as draft:
                    draft.write_bytes(data)
                yield folder / file
        path = folder / f"{stem}.{form}.json"
        publish_json(path, _card(card, regressions, channels, files, form))
        yield path


def exported_regressions(model: Any, inputs: FloatArray) -> list[ExportedRegression]:
    """Return the regressions of a trained model of any kind in `KINDS`.

    Args:
        model: Motion primitives, a model of the lookahead distance, or a personal model.
        inputs: Golden inputs (n_rows, n_inputs), in the units of `input_channels`.

    Raises:
        ValueError: The inputs have another number of columns than the model or missing values.
    """
    if isinstance(model, SteeringModel):
        return [_motion_primitive(name, model.primitives, inputs) for name in sorted(model.primitives.regressions)]
    if isinstance(model, VelocityLookahead):
        plain = PlainRegression.of(model.regressions, model.classes)
        return [_exported(plain, model, inputs, model.predict(inputs))]
    plain = PlainRegression.of([model.regression])
    return [_exported(plain, model.regression, inputs, model.predict(inputs))]


def input_channels(model: Any) -> list[dict[str, Any]]:
    """Return what each input column is: name, unit and, of a window, its step from the present one."""
    window = model.window if isinstance(model, SteeringModel | PersonalModel) else None
    if window is None:
        return [{"name": "course_deviation", "unit": "deg per sample"}, {"name": "speed", "unit": "m/s"}]
    past_steps, future_steps = window
    path = range(-max(past_steps, 0), future_steps + 1)
    blocks = (
        ("course_deviation", "deg per sample", path),
        ("speed", "m/s", path),
        ("steering_wheel_angle", "deg", range(-past_steps, 1)),
    )
    return [{"name": name, "unit": unit, "step": step} for name, unit, steps in blocks for step in steps]


def _motion_primitive(name: str, primitives: MotionPrimitives, inputs: FloatArray) -> ExportedRegression:
    """Take one regression out, and predict as though every path type were its own."""
    regression, coordinates = primitives.regressions[name], primitives.coordinates
    calibration = primitives.calibrations.get(primitives.n1)
    calibrations = {} if calibration is None else {1: calibration}
    alone = MotionPrimitives(1, {EVERYTHING: regression}, {}, coordinates, calibrations)
    everything = np.full(len(inputs), EVERYTHING)
    mean, variance = alone.predict(inputs, everything)
    plain = PlainRegression.of([regression], coordinates=coordinates, calibration=calibration)
    return ExportedRegression(name, plain, inputs, mean, np.sqrt(variance), alone.domain_score(inputs, everything))


def _exported(
    plain: PlainRegression,
    model: MixtureRegression | VelocityLookahead,
    inputs: FloatArray,
    predicted: tuple[FloatArray, FloatArray],
) -> ExportedRegression:
    mean, sd = (values.reshape(len(inputs), -1) for values in predicted)
    return ExportedRegression("", plain, inputs, mean, sd, domain_score(model, inputs))


def _contents(
    one: ExportedRegression,
    card: Mapping[str, Any],
    identifier: str,
    stem: str,
    channels: list[dict[str, Any]],
    form: Form,
) -> dict[str, bytes]:
    """Return the files of a regression by name."""
    outputs = "; ".join(f"{name}, {facts['unit']}" for name, facts in card["outputs"].items())
    if form == "c":
        title = [card["title"], f"Regression: {one.name or EVERYTHING}. Written by Wheelprint {__version__}."]
        lines = [" ".join(str(value) for value in channel.values()) for channel in channels]
        header = c_header(one.plain, identifier, title, lines, f"mean, variance: {outputs} and its square")
        return {f"{stem}.h": header.encode()}
    facts = {"title": card["title"], "regression": one.name or EVERYTHING, "outputs": outputs, "driver": card["driver"]}
    return {
        f"{stem}{'.covariance' if covariance else ''}.{precision}.onnx": onnx_model(
            one.plain, identifier, precision, facts, covariance=covariance
        ).SerializeToString(deterministic=True)
        for precision in PRECISIONS
        for covariance in (False, True)
    }


def _card(
    card: Mapping[str, Any],
    regressions: list[ExportedRegression],
    channels: list[dict[str, Any]],
    files: Mapping[str, list[str]],
    form: Form,
) -> dict[str, Any]:
    own = {key: value for key, value in card.items() if key not in ("arrays", "sha256", "format", "kind")}
    return {
        **own,
        "model": card["kind"],
        "form": form,
        "exported_by": __version__,
        "input_columns": channels,
        "files": dict(files),
        "choice": HOW_TO_CHOOSE if card["kind"] == MODEL else "One file predicts everything.",
        "domain_score": {"unit": "nats", "meaning": "log density of the inputs where the model learnt"},
        "golden": {
            one.name or EVERYTHING: {
                key: values.tolist()
                for key, values in (
                    ("inputs", one.inputs), ("mean", one.mean), ("sd", one.sd), ("domain_score", one.domain_score),
                )
            }
            for one in regressions
        },
    }  # fmt: skip


def _require_onnx() -> None:
    from importlib.util import find_spec

    if find_spec("onnx") is None:
        reason = "the package onnx is not installed; install Wheelprint with the extra: pip install 'wheelprint[onnx]'"
        raise InputError("--to", "onnx", reason)


KINDS: Mapping[str, tuple[Callable[..., Any], Callable[..., tuple[NDArray[Any], ...]]]] = {
    MODEL: (SteeringModel.from_arrays, SteeringModel.predict),
    "lookahead_general": (GeneralLookahead.from_arrays, GeneralLookahead.predict),
    "lookahead_velocity": (VelocityLookahead.from_arrays, VelocityLookahead.predict),
    **dict.fromkeys(PERSONAL, (PersonalModel.from_arrays, PersonalModel.predict)),
}
