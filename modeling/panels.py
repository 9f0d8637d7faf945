"""Products of many rows with matrices that stay the same, compiled: packed once, they take little but the arithmetic.

BLAS packs a matrix anew for each product, and multiplies triangular ones at two thirds of the speed of others. Here the
sums of six rows with a few columns stay in vector registers until they are complete; what is written for LLVM itself is
that innermost loop, since numba keeps sums in memory.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from .estimator import FloatArray
from .vector_code import multiply_add, repeated

Floats = npt.NDArray[np.floating[Any]]

TOGETHER = 6
"""Rows that are multiplied at a time: with two registers of sums for each, and what is added, sixteen are nearly full.
"""

PANEL_BYTES = 64
"""Size of the sums of a row that are formed at a time."""


class Panels(NamedTuple):
    """Matrices (k, m, d), of any units, packed: m is filled up to p panels of as many columns of Mᵀ as `PANEL_BYTES`.

    Attributes:
        values: One panel after the other, each by rows of Mᵀ (k, …); their type is that of the products.
        begins: Where each panel begins among them (p,).
        reaches: Rows of Mᵀ in each panel, up to the last that is not zero in any of the matrices (p,).
    """

    values: Floats
    begins: npt.NDArray[np.int64]
    reaches: npt.NDArray[np.int64]


def packed(matrices: FloatArray, precision: npt.DTypeLike = np.float64) -> Panels:
    """Return matrices (k, m, d), of any units, as `multiply` takes them; zeros of lower triangular ones are left out.

    Args:
        matrices: See `Panels`.
        precision: What they are rounded to, and products are computed in: float64 or float32.
    """
    k, m, d = matrices.shape
    lanes = PANEL_BYTES // np.dtype(precision).itemsize
    filled = np.zeros((k, m + -m % lanes, d), dtype=precision)
    filled[:, :m] = matrices
    panels = filled.reshape(k, -1, lanes, d).transpose(1, 0, 3, 2)
    reaches = [int(np.flatnonzero(panel.any(axis=(0, 2))).max(initial=-1)) + 1 for panel in panels]
    values = [panel[:, :reach].reshape(k, -1) for panel, reach in zip(panels, reaches, strict=True)]
    begins = lanes * np.cumsum([0, *reaches[:-1]])
    return Panels(np.concatenate(values, axis=1), begins, np.array(reaches, dtype=np.int64))


@njit(cache=True, nogil=True)
def width(panels: Panels) -> int:
    """Return how many columns the panels have together, those that fill the last one up included."""
    return len(panels.reaches) * (PANEL_BYTES // panels.values.itemsize)


@intrinsic
def multiply(
    _typing: Any,
    values: Any,
    c: Any,
    begin: Any,
    reach: Any,
    rows: Any,
    first: Any,
    into: Any,
    place: Any,
    column: Any,
    squares: Any,
) -> tuple[Any, Any]:
    """Write what M x of `TOGETHER` rows x has in the columns of a panel, M the matrix c, into columns of `into`.

    It takes fields of `Panels`, since taking them from it each time costs as much as the product.

    Args:
        values: See `Panels`. The three arrays are of one type and without gaps; nothing is asked.
        c: Which of the matrices.
        begin: That of the panel.
        reach: That of the panel.
        rows: Shape (≥ first + TOGETHER, ≥ d).
        first: The first of the rows.
        into: Shape (≥ place + TOGETHER, ≥ width); columns from m on become zero.
        place: Row of `into` that the first goes to.
        column: First column of `into` that is written.
        squares: To which the sums of squares of what is written to the rows are added (TOGETHER,), or None.
    """

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> None:
        def array(place: int) -> Any:
            return context.make_array(signature.args[place])(context, builder, arguments[place])

        def whole(place: int) -> Any:
            return context.cast(builder, arguments[place], signature.args[place], types.intp)

        panels, x, y = array(0), array(4), array(6)
        number = context.get_value_type(signature.args[0].dtype)
        size = context.get_abi_sizeof(number)
        lanes = PANEL_BYTES // size
        vector = ir.VectorType(number, lanes)

        def as_vector(place: Any) -> Any:
            return builder.bitcast(place, vector.as_pointer())

        weights_of = builder.gep(_row_of(builder, panels, whole(1), 0), [whole(2)])
        x_rows = [_row_of(builder, x, whole(5), row) for row in range(TOGETHER)]
        sums = [cgutils.alloca_once(builder, vector) for _ in range(TOGETHER)]
        for own in sums:
            builder.store(ir.Constant(vector, [0.0] * lanes), own)
        with cgutils.for_range(builder, whole(3)) as loop:
            place = builder.mul(loop.index, ir.Constant(loop.index.type, lanes))
            weights = builder.load(as_vector(builder.gep(weights_of, [place])), align=size)
            for row, own in zip(x_rows, sums, strict=True):
                each = repeated(builder, builder.load(builder.gep(row, [loop.index])), lanes)
                builder.store(multiply_add(builder, each, weights, builder.load(own)), own)
        for row, own in enumerate(sums):
            to = builder.gep(_row_of(builder, y, whole(7), row), [whole(8)])
            builder.store(builder.load(own), as_vector(to), align=size)
        if signature.args[9] is not types.none:
            type_of = ir.FunctionType(number, [number, vector])
            reduction = f"llvm.vector.reduce.fadd.v{lanes}f{8 * size}"
            add_up = cgutils.get_or_insert_function(builder.module, type_of, reduction)
            for row, own in enumerate(sums):
                to = builder.gep(array(9).data, [ir.Constant(ir.IntType(64), row)])
                square = builder.fmul(builder.load(own), builder.load(own))
                builder.store(builder.call(add_up, [builder.load(to), square], fastmath=["reassoc"]), to)

    return types.void(values, c, begin, reach, rows, first, into, place, column, squares), emit


def _row_of(builder: Any, array: Any, row: Any, further: int) -> Any:
    """Write the code that finds a row of an array without gaps."""
    columns = cgutils.unpack_tuple(builder, array.shape)[1]
    return builder.gep(array.data, [builder.mul(builder.add(row, ir.Constant(row.type, further)), columns)])
