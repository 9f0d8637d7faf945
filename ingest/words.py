"""The bytes at any place as numbers, compiled: import it where it is used, numba is heavy.

In all of these `content` is uint8, contiguous, and `place`, uint64, is that of the first byte.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core.cgutils import get_or_insert_function
from numba.extending import intrinsic

SUMMED = 64
"""Bytes that `sum_at` adds up."""


def vector_at(context: Any, builder: Any, signature: Any, arguments: Any, lanes: int) -> Any:
    """Write the code that loads so many bytes as a vector: for intrinsics of a content and a place."""
    return _load(context, builder, signature, arguments, ir.VectorType(ir.IntType(8), lanes))


def _load(context: Any, builder: Any, signature: Any, arguments: Any, kind: Any) -> Any:
    octets = context.make_array(signature.args[0])(context, builder, arguments[0])
    first = builder.gep(octets.data, [arguments[1]])
    return builder.load(builder.bitcast(first, kind.as_pointer()), align=1)


def _as_number(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return _load(context, builder, signature, arguments, context.get_value_type(signature.return_type))


@intrinsic
def word_at(_typing: Any, content: Any, place: Any) -> tuple[Any, Any]:
    """Return eight bytes as one number, the first byte the lowest."""
    return types.uint64(content, place), _as_number


@intrinsic
def double_at(_typing: Any, content: Any, place: Any) -> tuple[Any, Any]:
    """Return eight bytes as a number of double precision."""
    return types.float64(content, place), _as_number


@intrinsic
def single_at(_typing: Any, content: Any, place: Any) -> tuple[Any, Any]:
    """Return four bytes as a number of single precision."""
    return types.float32(content, place), _as_number


@intrinsic
def sum_at(_typing: Any, content: Any, place: Any) -> tuple[Any, Any]:
    """Return the sum of 64 bytes, modulo 256."""

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        vector = ir.VectorType(ir.IntType(8), SUMMED)
        add = ir.FunctionType(ir.IntType(8), [vector])
        summed = get_or_insert_function(builder.module, add, f"llvm.vector.reduce.add.v{SUMMED}i8")
        return builder.call(summed, [vector_at(context, builder, signature, arguments, SUMMED)])

    return types.uint8(content, place), emit
