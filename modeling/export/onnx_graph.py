"""Mixture regressions as ONNX graphs of plain operators: any runtime computes them, in float64 or float32."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ..curvature import SLOWEST, CurvatureCoordinates
from ..lookahead_models import SPEED
from .plain_regression import PlainRegression, SpeedClasses

Precision = Literal["float64", "float32"]

OPSET = 17
IR_VERSION = 8
"""The oldest that has this opset: runtimes of 2022 and later read it."""


def onnx_model(
    plain: PlainRegression, name: str, precision: Precision, metadata: Mapping[str, str], *, covariance: bool
) -> Any:
    """Return the graph of a regression, checked.

    Its input is `inputs` (rows, n); its outputs are `mean` and `sd` (rows, m), `domain_score` (rows,) in nats and,
    where it is asked for, `covariance` (rows, m, m), by the formulas of `PlainRegression` and in the units of the
    model. All components' whitening and regression matrices stand in one matrix: a row is predicted by one product with
    it, and what is left is small.

    Args:
        plain: The regression.
        name: Of the graph.
        precision: Of inputs, outputs and everything between.
        metadata: Facts that a viewer of the file shows.
        covariance: Whether the covariance is an output: runtimes compute every output, also those not asked for.

    Returns:
        An `onnx.ModelProto`.

    Raises:
        ImportError: The extra `onnx` is not installed.
    """
    from onnx import TensorProto, checker, helper

    graph = _Graph(np.dtype(precision))
    _add_formulas(graph, plain, covariance=covariance)
    kind = {"float64": TensorProto.DOUBLE, "float32": TensorProto.FLOAT}[precision]
    m = plain.outputs
    shapes: dict[str, list[str | int]] = {"mean": ["rows", m], "sd": ["rows", m], "domain_score": ["rows"]}
    if covariance:
        shapes["covariance"] = ["rows", m, m]
    proto = helper.make_graph(
        graph.nodes,
        name,
        [helper.make_tensor_value_info("inputs", kind, ["rows", plain.given])],
        [helper.make_tensor_value_info(output, kind, shape) for output, shape in shapes.items()],
        graph.initializers,
    )
    model = helper.make_model(
        proto, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION, producer_name="wheelprint"
    )
    helper.set_model_props(model, dict(metadata))
    checker.check_model(model, full_check=True)
    return model


class _Graph:
    """Gathers the nodes and constants of a graph."""

    def __init__(self, dtype: np.dtype[Any]) -> None:
        self.dtype = dtype
        self.nodes: list[Any] = []
        self.initializers: list[Any] = []

    def constant(self, name: str, values: npt.ArrayLike, dtype: npt.DTypeLike | None = None) -> str:
        from onnx import numpy_helper

        array = np.ascontiguousarray(np.asarray(values, dtype=dtype or self.dtype))
        self.initializers.append(numpy_helper.from_array(array, name))
        return name

    def add(self, operator: str, inputs: list[str], *outputs: str, **attributes: Any) -> str:
        from onnx import helper

        self.nodes.append(helper.make_node(operator, inputs, list(outputs), name=f"to_{outputs[0]}", **attributes))
        return outputs[0]


def _add_formulas(graph: _Graph, plain: PlainRegression, *, covariance: bool) -> None:
    """Write the formulas of `PlainRegression`; shapes below are of `rows` rows.

    Whitening is divided by √2, so that its squares are ½ |z_k|², and a row of responsibilities stays a matrix of one
    row: each operator costs a microsecond before it computes anything.
    """
    k, n, m = plain.components, plain.inputs, plain.outputs
    add, constant = graph.add, graph.constant
    inputs = "inputs" if plain.coordinates is None else _add_coordinates(graph, plain.coordinates)
    calibrated = bool((plain.variance_factors != 1.0).any())
    add("Sub", [inputs, constant("origin", plain.origin)], "centred")  # (rows, n)
    whitening = plain.whitening[:, :, np.argsort(plain.order)] / np.sqrt(2.0)
    every = np.concatenate([whitening, plain.matrices], axis=1)  # (k, n + m, n)
    shift = np.concatenate([plain.shifts / np.sqrt(2.0), plain.offsets], axis=1)
    if graph.dtype == np.float64:
        # Measured with onnxruntime: it would copy a matrix of float64 to multiply by it from the right.
        matrices = constant("matrices", every.reshape(-1, n))
        add("Gemm", [matrices, "centred", constant("shifts", shift.reshape(-1, 1))], "columns", transB=1)
        add("Transpose", ["columns"], "product", perm=[1, 0])
    else:
        matrices = constant("matrices", every.reshape(-1, n).T)
        add("Gemm", ["centred", matrices, constant("shifts", shift.ravel())], "product")
    add("Reshape", ["product", constant("by_component", [-1, k, n + m], np.int64)], "shifted")
    add("Split", ["shifted", constant("parts", [n, m], np.int64)], "whitened", "means", axis=2)
    add("ReduceSumSquare", ["whitened"], "half_distance", axes=[2], keepdims=0)  # (rows, k)
    joint = add("Sub", [constant("log_constants", plain.constants), "half_distance"], "of_all")
    if plain.classes is not None:
        joint = _add_classes(graph, plain.classes)
    add("ReduceLogSumExp", [joint], "domain_score", axes=[1], keepdims=0)
    if plain.faithful:
        joint = add("Sub", [joint, constant("log_weights", plain.log_weights)], "log_densities")
    add("Softmax", [joint], "responsibilities", axis=1)
    one = constant("one", [1], np.int64)
    row = add("Unsqueeze", ["responsibilities", one], "row")  # (rows, 1, k)
    add("MatMul", [row, "means"], "mean_row")  # (rows, 1, m)
    if plain.coordinates is None or not plain.coordinates.seen:
        add("Squeeze", ["mean_row", one], "mean")
    else:
        add("Squeeze", ["mean_row", one], "change")
        add("Gather", ["inputs", constant("last", [plain.given - 1], np.int64)], "current_angle", axis=1)  # (rows, 1)
        add("Add", ["change", "current_angle"], "mean")
    mixing = add("Mul", ["responsibilities"] * 2, "squared") if plain.faithful else "responsibilities"
    variances = constant("variances", np.diagonal(plain.covariances, axis1=1, axis2=2))
    if plain.faithful:
        variance = add("MatMul", [mixing, variances], "variance")
    else:
        add("Sub", ["means", "mean_row"], "offset")  # (rows, k, m)
        add("Mul", ["offset", "offset"], "offset_squared")
        add("Add", ["offset_squared", variances], "second_moments")
        add("MatMul", [row, "second_moments"], "variance_row")
        variance = add("Squeeze", ["variance_row", one], "variance")
    if calibrated:
        variance = add("Mul", [variance, constant("variance_factors", plain.variance_factors)], "variance_calibrated")
    add("Sqrt", [variance], "sd")
    if not covariance:
        return
    add("MatMul", [mixing, constant("covariances", plain.covariances.reshape(k, m * m))], "covariance_flat")
    total = "covariance_stated" if calibrated else "covariance"
    within = total if plain.faithful else "covariance_within"
    add("Reshape", ["covariance_flat", constant("square", [-1, m, m], np.int64)], within)
    if not plain.faithful:
        add("Transpose", ["offset"], "offset_columns", perm=[0, 2, 1])  # (rows, m, k)
        add("Mul", ["offset_columns", row], "offset_weighted")
        add("MatMul", ["offset_weighted", "offset"], "covariance_between")
        add("Add", [within, "covariance_between"], total)
    if calibrated:
        root = np.sqrt(plain.variance_factors)
        add("Mul", [total, constant("covariance_factors", np.outer(root, root))], "covariance")


def _add_coordinates(graph: _Graph, coordinates: CurvatureCoordinates) -> str:
    """Write `CurvatureCoordinates.transform` of the windows (rows, n_inputs)."""
    add, constant = graph.add, graph.constant
    length, seen = coordinates.path_length, coordinates.seen
    names = ["deviation", "speed", *(["seen"] if seen else [])]
    add("Split", ["inputs", constant("window", [length, length, *([seen] if seen else [])], np.int64)], *names, axis=1)
    add("Max", ["speed", constant("slowest", SLOWEST)], "no_slower")
    add("Mul", ["deviation", constant("per_km", 1e3 * np.radians(1.0) / coordinates.step)], "turn")
    add("Div", ["turn", "no_slower"], "curvature")  # 1/km
    add("Mul", ["speed", "speed"], "speed_squared")
    add("Mul", ["curvature", constant("km", 1e-3)], "curvature_per_m")
    add("Mul", ["curvature_per_m", "speed_squared"], "lateral")
    gradient = np.gradient(np.eye(length), coordinates.step, axis=1)
    add("MatMul", ["speed", constant("gradient", gradient)], "acceleration")
    add("Mul", ["lateral", "acceleration"], "lateral_braking")
    add("Concat", ["curvature", "lateral", "lateral_braking", *names[2:]], "channels", axis=1)
    add("Sub", ["channels", constant("channel_means", coordinates.mean)], "channels_centred")
    return add("MatMul", ["channels_centred", constant("basis", coordinates.basis)], "coordinates")


def _add_classes(graph: _Graph, classes: SpeedClasses) -> str:
    """Write the choice of the class of speed: the components of all others get −∞."""
    add, constant = graph.add, graph.constant
    add("Gather", ["inputs", constant("speed_column", [SPEED], np.int64)], "speed", axis=1)  # (rows, 1)
    a, b, q = classes.polynomials.T
    add("Mul", ["speed", constant("class_quadratic", q)], "class_0")
    add("Add", ["class_0", constant("class_linear", b)], "class_1")
    add("Mul", ["class_1", "speed"], "class_2")
    add("Add", ["class_2", constant("class_constant", a)], "class_log_joint")
    add("ArgMax", ["class_log_joint"], "class", axis=1, keepdims=0)
    members = np.where(classes.of_component == np.arange(len(a))[:, None], 0.0, -np.inf)
    add("Gather", [constant("members", members), "class"], "member", axis=0)
    return add("Add", ["of_all", "member"], "of_class")
