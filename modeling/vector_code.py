"""Pieces of compiled code on vectors of numbers, written for LLVM itself: what numba has no words for."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils


def multiply_add(builder: Any, a: Any, b: Any, c: Any) -> Any:
    """Write the code of a b + c, of numbers or vectors of one type, in one instruction where the processor has it."""
    lanes, number = (f"v{a.type.count}", a.type.element) if isinstance(a.type, ir.VectorType) else ("", a.type)
    bits = 64 if isinstance(number, ir.DoubleType) else 32
    type_of = ir.FunctionType(a.type, [a.type] * 3)
    function = cgutils.get_or_insert_function(builder.module, type_of, f"llvm.fmuladd.{lanes}f{bits}")
    return builder.call(function, [a, b, c])


def repeated(builder: Any, number: Any, lanes: int) -> Any:
    """Write the code of a vector that holds a number in all of its lanes."""
    none, int32 = ir.Constant(ir.VectorType(number.type, lanes), ir.Undefined), ir.IntType(32)
    first = builder.insert_element(none, number, int32(0))
    return builder.shuffle_vector(first, none, ir.Constant(ir.VectorType(int32, lanes), [0] * lanes))
