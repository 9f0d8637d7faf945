"""Exports give the numbers of Python: ONNX in onnxruntime, C compiled C, on the golden vectors and beyond."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from wheelprint.modeling.export import exported_models
from wheelprint.modeling.export.c_header import c_header, c_identifier
from wheelprint.modeling.export.exported_models import Form, export_models
from wheelprint.modeling.export.plain_regression import PlainRegression, domain_score
from wheelprint.modeling.lookahead_models import VelocityLookahead
from wheelprint.modeling.mixture import GaussianMixture
from wheelprint.modeling.predict import load_steering_model
from wheelprint.modeling.regression import MixtureRegression
from wheelprint.modeling.storage import load_model
from wheelprint.modeling.train import plan_training
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project

Array = npt.NDArray[np.float64]
DRIVER = "王 小明"
KINDS = ("lookahead_general", "lookahead_velocity", "motion_primitives")
COMPILE = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic")
PLAIN_OPERATORS = {
    "Add", "ArgMax", "Concat", "Div", "Gather", "Gemm", "MatMul", "Max", "Mul", "ReduceLogSumExp", "ReduceSumSquare",
    "Reshape", "Softmax", "Split", "Sqrt", "Squeeze", "Sub", "Transpose", "Unsqueeze",
}  # fmt: skip

PROGRAM = """
#include <stdio.h>
%s
int main(void) {
    double inputs[200], mean[200], variance[200], scores[2];
    %s
    return 0;
}
"""
CALL = """
    for (int row = 0; row < {rows}; row++) {{
        if (fread(inputs, sizeof(double), {n}, stdin) != {n}) return 1;
        scores[0] = wheelprint_{name}_predict(inputs, mean, variance);
        scores[1] = wheelprint_{name}_domain_score(inputs);
        fwrite(mean, sizeof(double), {m}, stdout);
        fwrite(variance, sizeof(double), {m}, stdout);
        fwrite(scores, sizeof(double), 2, stdout);
    }}
"""


@pytest.fixture(scope="module")
def trained(project: Project, perform: Callable[..., Any]) -> Project:
    tasks, _ = plan_training(project)
    perform(project, [task for task in tasks if task.name.endswith(DRIVER)])
    return project


def compiler() -> str:
    found = shutil.which("cc") or shutil.which("gcc")
    if found is None:
        pytest.skip("no C compiler here: neither cc nor gcc is on the path")
    return found


def session(model: bytes | Path) -> Any:
    onnxruntime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed: the extra onnx")
    content = model.read_bytes() if isinstance(model, Path) else model
    return onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])


def run_onnx(model: bytes | Path, inputs: Array, precision: str) -> dict[str, Array]:
    running = session(model)
    names = [output.name for output in running.get_outputs()]
    return dict(zip(names, running.run(None, {"inputs": inputs.astype(precision)}), strict=True))


def run_c(folder: Path, headers: dict[str, str], inputs: list[Array], outputs: list[int]) -> list[dict[str, Array]]:
    """Compile one program of several headers, by name, and return what each predicts for its inputs."""
    calls = "".join(
        CALL.format(rows=len(rows), n=rows.shape[1], m=m, name=name)
        for name, rows, m in zip(headers, inputs, outputs, strict=True)
    )
    includes = "\n".join(f'#include "{name}.h"' for name in headers)
    for name, text in headers.items():
        (folder / f"{name}.h").write_text(text, encoding="utf-8")
    (folder / "program.c").write_text(PROGRAM % (includes, calls), encoding="utf-8")
    program = folder / "program"
    subprocess.run([compiler(), *COMPILE, "-o", program, folder / "program.c", "-lm"], check=True)
    fed = b"".join(np.ascontiguousarray(rows).tobytes() for rows in inputs)
    read = np.frombuffer(subprocess.run([program], input=fed, capture_output=True, check=True).stdout)
    predictions = []
    for rows, m in zip(inputs, outputs, strict=True):
        part, read = read[: len(rows) * (2 * m + 2)].reshape(len(rows), -1), read[len(rows) * (2 * m + 2) :]
        np.testing.assert_array_equal(part[:, -2], part[:, -1])
        predictions.append({"mean": part[:, :m], "sd": np.sqrt(part[:, m : 2 * m]), "domain_score": part[:, -1]})
    assert read.size == 0
    return predictions


def agree(found: dict[str, Array], expected: dict[str, Array], tolerance: float) -> None:
    for name, values in expected.items():
        assert found[name].shape == values.shape, name
        np.testing.assert_allclose(found[name], values, rtol=0, atol=tolerance * np.abs(values).max(), err_msg=name)


def golden_of(card: dict[str, Any], regression: str) -> tuple[Array, dict[str, Array]]:
    golden = {name: np.array(values) for name, values in card["golden"][regression].items()}
    return golden.pop("inputs"), golden


def test_onnx_reproduces_the_golden_vectors_of_every_model(trained: Project, tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="onnx is not installed: the extra onnx")
    written = list(export_models(trained, tmp_path, DRIVER, "onnx"))
    cards = [path for path in written if path.suffix == ".json"]
    assert [path.name.split(".")[0] for path in cards] == list(KINDS)
    assert sorted(written) == sorted(tmp_path.iterdir())
    compared = 0
    for path in cards:
        card = json.loads(path.read_text(encoding="utf-8"))
        model, _ = load_model(trained.model_folder(card["model"], DRIVER), exported_models.KINDS)
        for regression, files in card["files"].items():
            inputs, golden = golden_of(card, regression)
            for file in files:
                single = file.endswith(".float32.onnx")
                found = run_onnx(tmp_path / file, inputs, "float32" if single else "float64")
                expected = dict(golden)
                if ".covariance." in file:
                    plain, factors = model.regression if card["model"] == "lookahead_general" else None, np.ones(1)
                    if card["model"] == "motion_primitives":
                        plain = model.primitives.regressions[regression]
                        factors = model.primitives.calibrations[27].variance(np.ones(5))
                    if plain is not None:
                        covariance = plain.predict(inputs, return_covariance=True)[1]
                        expected["covariance"] = covariance * np.sqrt(np.outer(factors, factors))
                assert found.keys() == {"mean", "sd", "domain_score"} | ({"covariance"} & {*found})
                assert ("covariance" in found) == (".covariance." in file)
                agree(found, expected, 1e-4 if single else 1e-9)
                compared += 1
    assert compared == 4 * (1 + 1 + len(model.primitives.regressions))
    assert len(model.primitives.regressions) > 2


def test_c_reproduces_the_golden_vectors_of_every_model_in_one_program(trained: Project, tmp_path: Path) -> None:
    written = list(export_models(trained, tmp_path, DRIVER, "c"))
    headers, inputs, expected = {}, [], []
    for path in written:
        if path.suffix != ".json":
            continue
        card = json.loads(path.read_text(encoding="utf-8"))
        for regression, (file,) in card["files"].items():
            text = (tmp_path / file).read_text(encoding="utf-8")
            name = text.split("#ifndef WHEELPRINT_")[1].split("_H\n")[0]
            headers[name] = text
            assert f"double wheelprint_{name}_predict(const double *inputs, double *mean, double *variance)" in text
            rows, golden = golden_of(card, regression)
            inputs.append(rows)
            expected.append(golden)
    assert "lookahead_velocity__u738b__u20__u5c0f__u660e_" in headers
    assert "motion_primitives__u738b__u20__u5c0f__u660e__all" in headers
    found = run_c(tmp_path, headers, inputs, [golden["mean"].shape[1] for golden in expected])
    for one, golden in zip(found, expected, strict=True):
        agree(one, golden, 1e-9)


@pytest.mark.parametrize("past_steps", [-1, 1])
@pytest.mark.parametrize("calibrate", [False, True])
def test_curvature_and_calibration_are_part_of_the_export(
    own_project: Project, perform: Callable[..., Any], tmp_path: Path, past_steps: int, *, calibrate: bool
) -> None:
    """The files that the path types name say what the model itself says: transform, last angle, bands and score."""
    pytest.importorskip("onnx", reason="onnx is not installed: the extra onnx")
    path = own_project.directory / "wheelprint.toml"
    asked = f'calibrate = {str(calibrate).lower()}\ninputs = ["curvature"]\n'
    text = path.read_text(encoding="utf-8").replace('inputs = ["curvature", "paper"]\n', asked)
    text = text.replace("past_steps = [-1, 1]\n", f"past_steps = [{past_steps}]\n")
    path.write_text(text, encoding="utf-8")
    project = Project(own_project.directory)
    perform(project, [task for task in plan_training(project)[0] if task.name == f"motion_primitives/{DRIVER}"])
    model = load_steering_model(project, DRIVER)
    assert model.primitives.coordinates is not None
    assert bool(model.primitives.calibrations) == calibrate
    with np.load(project.model_folder("motion_primitives", DRIVER) / "golden.npz") as golden:
        inputs, path_types, mean, sd = (golden[name] for name in ("input_0", "input_1", "prediction_0", "prediction_1"))
    names = np.array([model.primitives.model_of(path_type) for path_type in path_types.tolist()])
    score = model.primitives.domain_score(inputs, path_types)
    list(export_models(project, tmp_path, DRIVER, "onnx"))
    list(export_models(project, tmp_path, DRIVER, "c"))
    stem = "motion_primitives.%E7%8E%8B%20%E5%B0%8F%E6%98%8E"
    compared = 0
    for name in np.unique(names).tolist():
        own = names == name
        expected = {"mean": mean[own], "sd": sd[own], "domain_score": score[own]}
        header = (tmp_path / f"{stem}.{name}.h").read_text(encoding="utf-8")
        identifier = header.split("#ifndef WHEELPRINT_")[1].split("_H\n")[0]
        (compiled,) = run_c(tmp_path, {identifier: header}, [inputs[own]], [mean.shape[1]])
        agree(compiled, expected, 1e-9)
        for precision, tolerance in (("float64", 1e-9), ("float32", 1e-4)):
            for covariance in ("", ".covariance"):
                found = run_onnx(tmp_path / f"{stem}.{name}{covariance}.{precision}.onnx", inputs[own], precision)
                agree(found, expected, tolerance)
                if covariance:
                    spread = np.sqrt(np.diagonal(found["covariance"], axis1=1, axis2=2))
                    np.testing.assert_allclose(spread, sd[own], rtol=tolerance)
        compared += own.sum()
    assert compared == len(inputs)


def regression(n: int, m: int, k: int, *, faithful: bool = False, seed: int = 0) -> MixtureRegression:
    """A regression whose components lie apart by a few deviations, one of them hardly ever used."""
    generator = np.random.default_rng(seed)
    d = n + m
    factors = generator.normal(size=(d, d)) / np.sqrt(d) + 0.5 * np.eye(d)
    factors = factors @ (np.eye(d) + 0.5 / d * generator.normal(size=(k, d, d)))
    weights = generator.dirichlet(np.ones(k))
    weights[-1] *= 1e-12
    mixture = GaussianMixture.from_parameters(
        weights, 20 + generator.normal(size=(k, d)) @ factors[0].T / np.sqrt(d), factors @ factors.transpose(0, 2, 1)
    )
    columns = np.arange(d)
    return MixtureRegression.from_mixture(mixture, columns[:n], columns[n:], faithful=faithful)


@pytest.mark.parametrize("faithful", [False, True])
@pytest.mark.parametrize(("n", "m", "k"), [(1, 1, 1), (16, 16, 3), (17, 3, 5), (106, 50, 9)])
def test_any_shape_and_any_input(tmp_path: Path, n: int, m: int, k: int, *, faithful: bool) -> None:
    """Rows from every component, and rows far from all of them, where only logarithms still tell them apart."""
    pytest.importorskip("onnx", reason="onnx is not installed: the extra onnx")
    from wheelprint.modeling.export.onnx_graph import onnx_model

    model = regression(n, m, k, faithful=faithful)
    rows = model.mixture_.sample(40)[0][:, :n]
    rows = np.concatenate([rows, model.mixture_.means_[:, :n], rows[:3] + 30.0, rows[:3] - 1e3])
    mean, covariance = model.predict(rows, return_covariance=True)
    sd = model.predict(rows, return_sd=True)[1]
    near = {"mean": mean, "sd": sd, "domain_score": domain_score(model, rows)}
    if k > 2:
        assert ((model.responsibilities(rows) > 0.01).sum(axis=1) > 1).sum() > 5
    plain = PlainRegression.of([model])
    found = run_onnx(onnx_model(plain, "one", "float64", {}, covariance=True).SerializeToString(), rows, "float64")
    agree(found, near | {"covariance": covariance}, 1e-9)
    (compiled,) = run_c(tmp_path, {"one": c_header(plain, "one", ["One"], [], "outputs")}, [rows], [m])
    agree(compiled, near, 1e-9)


def test_a_velocity_model_is_scored_and_predicted_by_the_class_at_hand(tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="onnx is not installed: the extra onnx")
    from wheelprint.modeling.export.onnx_graph import onnx_model

    generator = np.random.default_rng(0)
    speed = np.concatenate([generator.normal(centre, 1.0, 300) for centre in (4.0, 12.0, 25.0)])
    inputs = np.column_stack([generator.normal(0, 1, 900), speed])
    model = VelocityLookahead(6, 3).fit(inputs, 3 + speed + inputs[:, 0] ** 2)
    rows = np.concatenate([inputs[::9], [[0.0, 8.0], [5.0, 60.0], [-9.0, -3.0]]])
    mean, sd = (values[:, None] for values in model.predict(rows))
    score = domain_score(model, rows)
    own = model.classes.predict(rows[:, [1]])
    assert set(own.tolist()) == {0, 1, 2}
    for row, one, number in zip(rows, score, own, strict=True):
        assert one == pytest.approx(model.regressions[number].domain_score(row[None])[0], rel=1e-12)
    expected = {"mean": mean, "sd": sd, "domain_score": score}
    plain = PlainRegression.of(model.regressions, model.classes)
    (compiled,) = run_c(tmp_path, {"v": c_header(plain, "v", ["V"], [], "outputs")}, [rows], [1])
    agree(compiled, expected, 1e-9)
    for precision, tolerance in (("float64", 1e-9), ("float32", 1e-4)):
        graph = onnx_model(plain, "v", precision, {}, covariance=True).SerializeToString()  # type: ignore[arg-type]
        found = run_onnx(graph, rows[:-2], precision)
        agree(found, {name: values[:-2] for name, values in expected.items()}, tolerance)


def test_graphs_are_plain_operators_of_one_precision(trained: Project, tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx", reason="onnx is not installed: the extra onnx")
    for path in export_models(trained, tmp_path, DRIVER, "onnx"):
        if path.suffix == ".json":
            continue
        model = onnx.load(path)
        assert {node.domain for node in model.graph.node} == {""}
        assert {node.op_type for node in model.graph.node} <= PLAIN_OPERATORS
        own, other = ("FLOAT", "DOUBLE") if ".float32." in path.name else ("DOUBLE", "FLOAT")
        kinds = {onnx.TensorProto.DataType.Name(one.data_type) for one in model.graph.initializer}
        assert own in kinds
        assert other not in kinds
        facts = {prop.key: prop.value for prop in model.metadata_props}
        assert facts["driver"] == DRIVER
        assert facts.keys() == {"title", "regression", "outputs", "driver"}


def test_the_card_says_what_goes_in_and_which_file_predicts(trained: Project, tmp_path: Path) -> None:
    list(export_models(trained, tmp_path, DRIVER, "c"))
    stem = "motion_primitives.%E7%8E%8B%20%E5%B0%8F%E6%98%8E"
    card = json.loads((tmp_path / f"{stem}.c.json").read_text(encoding="utf-8"))
    assert card["driver"] == DRIVER
    assert card["files"]["all"] == [f"{stem}.all.h"]
    columns = card["input_columns"]
    assert len(columns) == 16 == len(card["golden"]["all"]["inputs"][0])
    assert columns[0] == {"name": "course_deviation", "unit": "deg per sample", "step": -1}
    assert columns[-1] == {"name": "steering_wheel_angle", "unit": "deg", "step": 0}
    assert [column["step"] for column in columns[7:14]] == [-1, 0, 1, 2, 3, 4, 5]
    header = (tmp_path / f"{stem}.all.h").read_text(encoding="utf-8")
    assert " * inputs[15]  steering_wheel_angle deg 0\n" in header
    assert "malloc" not in header
    assert all(card[key] for key in ("limits", "ranges", "dataset", "choice", "parameters", "hours"))


def test_the_same_models_give_the_same_bytes(trained: Project, tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="onnx is not installed: the extra onnx")
    forms: tuple[Form, ...] = ("c", "onnx")
    for form in forms:
        first, second = (list(export_models(trained, tmp_path / place, DRIVER, form)) for place in ("a", "b"))
        assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


def test_identifiers_of_different_names_differ() -> None:
    assert c_identifier("driver01") == "driver01"
    names = ["b.~", "b_", "b", "b_u2e_", "b.", "王", "u738b"]
    assert len({c_identifier(name) for name in names}) == len(names)
    assert all(c_identifier(name).replace("_", "").isalnum() for name in names)


def test_without_the_extra_it_says_how_to_get_it(
    trained: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(InputError) as caught:
        list(export_models(trained, tmp_path, None, "onnx"))
    assert str(caught.value) == (
        "--to: onnx: the package onnx is not installed; install Wheelprint with the extra: pip install "
        "'wheelprint[onnx]'"
    )
