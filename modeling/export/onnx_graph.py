"""Mixture regressions as ONNX graphs of plain operators: any runtime computes them, in float64 or float32."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ..lookahead_models import SPEED
from .plain_regression import PlainRegression

Precision = Literal["float64", "float32"]

OPSET = 17
IR_VERSION = 8
"""The oldest that has this opset: runtimes of 2022 and later read it."""

OUTPUTS = ("mean", "sd", "covariance", "domain_score")


def onnx_model(plain: PlainRegression, name: str, precision: Precision, metadata: Mapping[str, str]) -> Any:
    """Return the graph of a regression, checked.

    Its input is `inputs` (rows, n); its outputs are `mean` and `sd` (rows, m), `covariance` (rows, m, m) and
    `domain_score` (rows,), of the formulas of `PlainRegression`. All components' whitening and regression matrices
    stand in one matrix: a row is predicted by one product with it, and what is left is small.

    Args:
        plain: The regression.
        name: Of the graph.
        precision: Of inputs, outputs and everything between.
        metadata: Facts that a viewer of the file shows.

    Returns:
        An `onnx.ModelProto`.

    Raises:
        ImportError: The extra `onnx` is not installed.
    """
    from onnx import TensorProto, checker, helper

    graph = _Graph(np.dtype(precision))
    _add_formulas(graph, plain)
    kind = {"float64": TensorProto.DOUBLE, "float32": TensorProto.FLOAT}[precision]
    m = plain.outputs
    shapes = {"mean": ["rows", m], "sd": ["rows", m], "covariance": ["rows", m, m], "domain_score": ["rows"]}
    proto = helper.make_graph(
        graph.nodes,
        name,
        [helper.make_tensor_value_info("inputs", kind, ["rows", plain.inputs])],
        [helper.make_tensor_value_info(output, kind, shapes[output]) for output in OUTPUTS],
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
        self._dtype = dtype
        self.nodes: list[Any] = []
        self.initializers: list[Any] = []

    def constant(self, name: str, values: npt.ArrayLike, dtype: npt.DTypeLike = None) -> str:
        from onnx import numpy_helper

        array = np.ascontiguousarray(np.asarray(values, dtype=dtype or self._dtype))
        self.initializers.append(numpy_helper.from_array(array, name))
        return name

    def add(self, operator: str, inputs: list[str], *outputs: str, **attributes: Any) -> str:
        from onnx import helper

        self.nodes.append(helper.make_node(operator, inputs, list(outputs), name=f"to_{outputs[0]}", **attributes))
        return outputs[0]


def _add_formulas(graph: _Graph, plain: PlainRegression) -> None:
    """Write the formulas of `PlainRegression`; shapes below are of `rows` rows."""
    k, n, m = plain.components, plain.inputs, plain.outputs
    add, constant = graph.add, graph.constant
    add("Sub", ["inputs", constant("origin", plain.origin)], "centred")  # (rows, n)
    every = np.concatenate([plain.whitening.reshape(k * n, n), plain.matrices.reshape(k * m, n)])
    shift = np.concatenate([plain.shifts.ravel(), plain.offsets.ravel()])
    add("MatMul", ["centred", constant("matrices", every.T)], "product")
    add("Add", ["product", constant("shifts", shift)], "shifted")  # (rows, k (n + m))
    constant("parts", [k * n, k * m], np.int64)
    add("Split", ["shifted", "parts"], "whitened_flat", "means_flat", axis=1)
    add("Reshape", ["whitened_flat", constant("whitened_shape", [-1, k, n], np.int64)], "whitened")
    add("Reshape", ["means_flat", constant("means_shape", [-1, k, m], np.int64)], "means")
    add("ReduceSumSquare", ["whitened"], "distance", axes=[2], keepdims=0)  # (rows, k)
    add("Mul", ["distance", constant("minus_half", -0.5)], "exponent")
    add("Add", ["exponent", constant("log_constants", plain.constants)], "of_all")
    joint = "of_all" if plain.classes is None else _add_classes(graph, plain)
    add("ReduceLogSumExp", [joint], "domain_score", axes=[1], keepdims=0)
    if plain.faithful:
        joint = add("Sub", [joint, constant("log_weights", plain.log_weights)], "log_densities")
    add("Softmax", [joint], "responsibilities", axis=1)
    add("Unsqueeze", ["responsibilities", constant("one", [1], np.int64)], "row")  # (rows, 1, k)
    add("MatMul", ["row", "means"], "mean_row")  # (rows, 1, m)
    add("Squeeze", ["mean_row", "one"], "mean")
    mixing = "responsibilities"
    if plain.faithful:
        mixing = add("Mul", ["responsibilities", "responsibilities"], "squared")
    variances = np.diagonal(plain.covariances, axis1=1, axis2=2)
    within = add("MatMul", [mixing, constant("variances", variances)], "variance_within")
    # Symmetric matrices that would be gathered from triangles cost more than whole ones.
    spread = add("MatMul", [mixing, constant("covariances", plain.covariances.reshape(k, m * m))], "covariance_flat")
    shape = constant("covariance_shape", [-1, m, m], np.int64)
    if plain.faithful:
        add("Sqrt", [within], "sd")
        add("Reshape", [spread, shape], "covariance")
        return
    add("Sub", ["means", "mean_row"], "offset")  # (rows, k, m)
    add("Mul", ["offset", "offset"], "offset_squared")
    add("MatMul", ["row", "offset_squared"], "variance_between_row")
    add("Squeeze", ["variance_between_row", "one"], "variance_between")
    add("Add", [within, "variance_between"], "variance")
    add("Sqrt", ["variance"], "sd")
    add("Reshape", [spread, shape], "covariance_within")
    add("Transpose", ["offset"], "offset_columns", perm=[0, 2, 1])  # (rows, m, k)
    add("Mul", ["offset_columns", "row"], "offset_weighted")
    add("MatMul", ["offset_weighted", "offset"], "covariance_between")
    add("Add", ["covariance_within", "covariance_between"], "covariance")


def _add_classes(graph: _Graph, plain: PlainRegression) -> str:
    """Write the choice of the class of speed: the components of all others get −∞."""
    classes = plain.classes
    assert classes is not None  # noqa: S101 - the caller's condition
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
