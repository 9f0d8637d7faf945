"""Models on disk: arrays, a model card, and golden vectors that a loaded model must reproduce. No pickle anywhere.

arrays.npz    what the model is rebuilt from
golden.npz    a few inputs (input_0, …) and their predictions (prediction_0, …)
card.json     what the model is, where it comes from, and the SHA-256 of the other two; published last
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from ..schemas.errors import InputError
from ..schemas.store import publish, publish_json, sha256

Arrays = Mapping[str, npt.NDArray[Any]]
Model = TypeVar("Model")

FORMAT = 2
"""Of the arrays: 2 has the division of paths among a steering model's."""
ARRAYS, GOLDEN, CARD = "arrays.npz", "golden.npz", "card.json"

GOLDEN_TOLERANCE = 1e-9
"""Relative to the largest prediction: another BLAS or processor sums in another order."""

RETRAIN = "train the model again"


@dataclass(frozen=True, slots=True)
class Golden:
    """Inputs of a model and what it predicted for them when it was saved.

    Attributes:
        inputs: Arguments of the prediction, numbers or fixed-width strings, (n_rows, …) each.
        predictions: The arrays that it returned, (n_rows, …) each.
    """

    inputs: tuple[npt.NDArray[Any], ...]
    predictions: tuple[npt.NDArray[Any], ...]


def save_model(folder: Path, kind: str, arrays: Arrays, card: Mapping[str, Any], golden: Golden) -> list[Path]:
    """Publish a model.

    The same model gives the same bytes: nothing in them says when or where they were written.

    Args:
        folder: Where; files of a model that was there are replaced.
        kind: What `load_model` rebuilds it by.
        arrays: Numbers, booleans or fixed-width strings by name.
        card: Whatever JSON holds and a reader of the card should know: driver, data, errors, limits.
        golden: What the model must reproduce when it is loaded.

    Returns:
        The files, the card last.
    """
    examples = {f"input_{place}": values for place, values in enumerate(golden.inputs)}
    examples |= {f"prediction_{place}": values for place, values in enumerate(golden.predictions)}
    files = [folder / ARRAYS, folder / GOLDEN, folder / CARD]
    for path, content in zip(files, (arrays, examples), strict=False):
        with publish(path) as draft:
            _write_arrays(draft, content)
    facts = {
        "format": FORMAT,
        "kind": kind,
        "arrays": {name: list(values.shape) for name, values in arrays.items()},
        "sha256": {path.name: sha256(path) for path in files[:2]},
    }
    publish_json(files[2], {**card, **facts})
    return files


def load_card(folder: Path) -> dict[str, Any]:
    """Read a model's card.

    Raises:
        InputError: There is none, it is not JSON, or another version of Wheelprint wrote it in another format.
    """
    path = folder / CARD
    try:
        card: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(path, "", f"no such file, hence no model here; {RETRAIN}") from None
    except ValueError as error:
        raise InputError(path, "", f"not JSON ({error}); {RETRAIN}") from None
    if card.get("format") != FORMAT:
        reason = f"expected {FORMAT}, found {card.get('format')}: another version wrote it; {RETRAIN}"
        raise InputError(path, "format", reason)
    return card


def load_model(
    folder: Path,
    kinds: Mapping[str, tuple[Callable[[Arrays], Model], Callable[..., tuple[npt.NDArray[Any], ...]]]],
) -> tuple[Model, dict[str, Any]]:
    """Load a model and let it predict its golden vectors.

    Args:
        folder: Where it was saved.
        kinds: By kind, what rebuilds a model from its arrays, and what predicts: a function of the model and the
            golden inputs.

    Returns:
        The model and its card.

    Raises:
        InputError: A file is missing or changed, another version wrote it, the kind is unknown, or a prediction p is
            not reproduced: |p − golden| > `GOLDEN_TOLERANCE` · max |golden|.
    """
    card = load_card(folder)
    if card["kind"] not in kinds:
        reason = f"a model of kind {card['kind']!r}; known here: {', '.join(sorted(kinds))}"
        raise InputError(folder / CARD, "kind", reason)
    arrays, examples = (_read_arrays(folder / name, card["sha256"][name]) for name in (ARRAYS, GOLDEN))
    rebuild, predict = kinds[card["kind"]]
    model = rebuild(arrays)
    inputs, expected = (
        [examples[f"{name}_{place}"] for place in range(sum(key.startswith(name) for key in examples))]
        for name in ("input", "prediction")
    )
    for place, (now, then) in enumerate(zip(predict(model, *inputs), expected, strict=True)):
        limit = GOLDEN_TOLERANCE * np.abs(then).max(initial=0.0)
        if now.shape != then.shape or not (np.abs(now - then) <= limit).all():
            difference = "another shape" if now.shape != then.shape else f"up to {np.abs(now - then).max():.3g} off"
            reason = (
                f"the loaded model does not reproduce what it predicted when it was saved ({difference}): the files "
                f"are damaged or this version of Wheelprint computes otherwise; {RETRAIN}"
            )
            raise InputError(folder / GOLDEN, f"prediction_{place}", reason)
    return model, card


def _write_arrays(path: Path, arrays: Arrays) -> None:
    """Write an `.npz`: as `np.savez` does, but in the order of names and without the time of writing."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, values in sorted(arrays.items()):
            member = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            member.create_system = 3
            with archive.open(member, "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asarray(values, order="C"), allow_pickle=False)


def _read_arrays(path: Path, digest: str) -> dict[str, npt.NDArray[Any]]:
    if not path.exists():
        raise InputError(path, "", f"no such file, but the model's card names it; {RETRAIN}")
    if sha256(path) != digest:
        raise InputError(path, "", f"not the file that the model's card was written for (SHA-256 differs); {RETRAIN}")
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)
