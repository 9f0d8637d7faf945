"""Models on disk: the same bytes, the same predictions, and what is said of damaged ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from wheelprint.modeling.lookahead_models import GeneralLookahead, VelocityLookahead
from wheelprint.modeling.regression import MixtureRegression
from wheelprint.modeling.storage import Golden, load_card, load_model, save_model
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.store import sha256

Array = npt.NDArray[np.float64]
KINDS: dict[str, Any] = {
    "general": (GeneralLookahead.from_arrays, GeneralLookahead.predict),
    "velocity": (VelocityLookahead.from_arrays, VelocityLookahead.predict),
}


def samples() -> tuple[Array, Array]:
    generator = np.random.default_rng(0)
    inputs = generator.normal([0.0, 12.0], 1.0, (500, 2))
    return inputs, 5 + inputs[:, 1] - inputs[:, 0] + 0.3 * generator.standard_normal(500)


def saved(folder: Path) -> tuple[GeneralLookahead, Array]:
    inputs, lookahead = samples()
    model = GeneralLookahead(3).fit(inputs, lookahead)
    golden = Golden((inputs[:5],), model.predict(inputs[:5]))
    files = save_model(folder, "general", model.arrays(), {"driver": "Łukasz", "hours": 1.5}, golden)
    assert [path.name for path in files] == ["arrays.npz", "golden.npz", "card.json"]
    return model, inputs


def test_comes_back_with_its_card(tmp_path: Path) -> None:
    model, inputs = saved(tmp_path)
    again, card = load_model(tmp_path, KINDS)
    for now, then in zip(again.predict(inputs), model.predict(inputs), strict=True):
        np.testing.assert_allclose(now, then, rtol=1e-12)
    assert card == load_card(tmp_path)
    assert card == {
        "driver": "Łukasz",
        "hours": 1.5,
        "format": 2,
        "kind": "general",
        "arrays": {
            "weights": [3], "means": [3, 3], "covariances": [3, 3, 3], "outputs": [], "single_output": [],
            "faithful": [],
        },
        "sha256": {name: sha256(tmp_path / name) for name in ("arrays.npz", "golden.npz")},
    }  # fmt: skip


def test_the_velocity_based_model_comes_back(tmp_path: Path) -> None:
    inputs, lookahead = samples()
    model = VelocityLookahead(6, 2).fit(inputs, lookahead)
    save_model(tmp_path, "velocity", model.arrays(), {}, Golden((inputs[:5],), model.predict(inputs[:5])))
    again, _ = load_model(tmp_path, KINDS)
    np.testing.assert_allclose(again.predict(inputs), model.predict(inputs), rtol=1e-12)


def test_the_same_model_gives_the_same_bytes_without_a_time(tmp_path: Path) -> None:
    saved(tmp_path / "a")
    saved(tmp_path / "b")
    for name in ("arrays.npz", "golden.npz", "card.json"):
        content = (tmp_path / "a" / name).read_bytes()
        assert content == (tmp_path / "b" / name).read_bytes()
    # The order of the arrays in memory does not show either.
    inputs, lookahead = samples()
    model = GeneralLookahead(3).fit(inputs, lookahead)
    arrays = {name: np.array(values, order="F") for name, values in reversed(model.arrays().items())}
    save_model(tmp_path / "c", "general", arrays, {}, Golden((), ()))
    assert (tmp_path / "c" / "arrays.npz").read_bytes() == (tmp_path / "a" / "arrays.npz").read_bytes()


def test_numpy_reads_the_arrays_without_pickle(tmp_path: Path) -> None:
    arrays = {"a/b": np.arange(6.0).reshape(2, 3), "names": np.array(["1-3-2", "1"]), "flag": np.array(True)}
    save_model(tmp_path, "any", arrays, {}, Golden((), ()))
    with np.load(tmp_path / "arrays.npz", allow_pickle=False) as archive:
        assert sorted(archive) == ["a/b", "flag", "names"]
        for name, values in arrays.items():
            np.testing.assert_array_equal(archive[name], values)
            assert archive[name].shape == values.shape
    with pytest.raises(ValueError, match=r"^Object arrays cannot be saved when allow_pickle=False$"):
        save_model(tmp_path, "any", {"a": np.array([object()])}, {}, Golden((), ()))


def test_a_model_that_predicts_otherwise_is_refused(tmp_path: Path) -> None:
    saved(tmp_path)

    def off_by_a_little(model: GeneralLookahead, inputs: Array) -> tuple[Array, Array]:
        mean, sd = model.predict(inputs)
        return mean, sd * (1 + 1e-6)

    with pytest.raises(InputError) as error:
        load_model(tmp_path, {"general": (GeneralLookahead.from_arrays, off_by_a_little)})
    assert error.value.where == "prediction_1"
    assert error.value.reason.startswith(
        "the loaded model does not reproduce what it predicted when it was saved (up to 3"
    )
    assert error.value.reason.endswith(
        "e-07 off): the files are damaged or this version of Wheelprint computes otherwise; train the model again"
    )
    with pytest.raises(InputError, match=r"when it was saved \(another shape\): the files"):
        load_model(tmp_path, {"general": (GeneralLookahead.from_arrays, lambda m, x: (m.predict(x)[0][1:], x))})


def test_golden_vectors_may_hold_names(tmp_path: Path) -> None:
    model, inputs = saved(tmp_path)
    types = np.array(["1-3-2", "1-1-1"])
    golden = Golden((inputs[:2], types), model.predict(inputs[:2]))
    save_model(tmp_path, "typed", model.arrays(), {}, golden)
    seen = []

    def predict(model: MixtureRegression, rows: Array, names: npt.NDArray[np.str_]) -> tuple[Array, Array]:
        seen.extend(names.tolist())
        return model.predict(rows, return_sd=True)

    load_model(tmp_path, {"typed": (MixtureRegression.from_arrays, predict)})
    assert seen == ["1-3-2", "1-1-1"]


@pytest.mark.parametrize(
    ("damage", "where", "reason"),
    [
        (
            lambda folder: (folder / "card.json").unlink(),
            "card.json",
            "no such file, hence no model here; train the model again",
        ),
        (
            lambda folder: (folder / "card.json").write_text("nothing"),
            "card.json",
            "not JSON (Expecting value: line 1 column 1 (char 0)); train the model again",
        ),
        (
            lambda folder: (folder / "card.json").write_text(json.dumps({"format": 1})),
            "card.json: format",
            "expected 2, found 1: another version wrote it; train the model again",
        ),
        (
            lambda folder: (folder / "card.json").write_text(json.dumps({"format": 2, "kind": "oracle"})),
            "card.json: kind",
            "a model of kind 'oracle'; known here: general, velocity",
        ),
        (
            lambda folder: (folder / "arrays.npz").unlink(),
            "arrays.npz",
            "no such file, but the model's card names it; train the model again",
        ),
        (
            lambda folder: (folder / "golden.npz").write_bytes((folder / "golden.npz").read_bytes()[:-1]),
            "golden.npz",
            "not the file that the model's card was written for (SHA-256 differs); train the model again",
        ),
    ],
)
def test_damage_is_named(tmp_path: Path, damage: Any, where: str, reason: str) -> None:
    saved(tmp_path)
    damage(tmp_path)
    with pytest.raises(InputError) as error:
        load_model(tmp_path, KINDS)
    assert str(error.value) == f"{tmp_path}/{where}: {reason}"
