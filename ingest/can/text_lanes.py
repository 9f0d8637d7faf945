"""Many characters of a text at once, compiled to vector instructions: import it where it is used, numba is heavy.

The characters at a place are a vector with a lane for each; the functions here are written for LLVM itself, since numba
does not see by itself that a loop over single characters can be done so.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from ..words import vector_at

LANES = 64
"""Characters that `newlines_at` and `blanks_at` look at."""
HEX_LANES = 16
"""Characters that `hex_at` looks at."""

_NEWLINE, _BLANK = 10, 32


def _each(value: int, count: int) -> Any:
    return ir.Constant(ir.VectorType(ir.IntType(8), count), [value] * count)


def _where(comparison: str, character: int) -> Any:
    """Return what writes the code that compares 64 bytes with a character."""

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        characters = vector_at(context, builder, signature, arguments, LANES)
        found = builder.icmp_unsigned(comparison, characters, _each(character, LANES))
        return builder.bitcast(found, ir.IntType(LANES))

    return emit


@intrinsic
def newlines_at(_typing: Any, content: Any, place: Any) -> tuple[Any, Any]:
    """Return which of 64 bytes end a line, a bit for each, the lowest for the first.

    Args:
        content: uint8, contiguous.
        place: uint64, of the first byte; 64 must be left from there on.
    """
    return types.uint64(content, place), _where("==", _NEWLINE)


@intrinsic
def blanks_at(_typing: Any, content: Any, place: Any) -> tuple[Any, Any]:
    """Return which of 64 bytes are blanks or control characters; see `newlines_at`."""
    return types.uint64(content, place), _where("<=", _BLANK)


@intrinsic
def hex_at(_typing: Any, content: Any, place: Any) -> tuple[Any, Any]:
    """Return what 16 bytes are as hex digits, and which of them are digits; see `newlines_at`.

    Returns:
        uint64, the eight bytes that eight pairs of digits are, the first one lowest; and uint64, a bit for each
        character, the lowest for the first. Other characters count as the digit 0.
    """
    returned = types.UniTuple(types.uint64, 2)

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        characters = vector_at(context, builder, signature, arguments, HEX_LANES)
        digit = builder.sub(characters, _each(ord("0"), HEX_LANES))
        letter = builder.sub(builder.or_(characters, _each(0x20, HEX_LANES)), _each(ord("a"), HEX_LANES))
        is_digit = builder.icmp_unsigned("<", digit, _each(10, HEX_LANES))
        is_letter = builder.icmp_unsigned("<", letter, _each(6, HEX_LANES))
        good = builder.or_(is_digit, is_letter)
        value = builder.select(is_digit, digit, builder.add(letter, _each(10, HEX_LANES)))
        value = builder.select(good, value, _each(0, HEX_LANES))

        def every_second(first: int) -> Any:
            places = ir.Constant(ir.VectorType(ir.IntType(32), HEX_LANES // 2), list(range(first, HEX_LANES, 2)))
            return builder.shuffle_vector(value, ir.Constant(value.type, ir.Undefined), places)

        pairs = builder.or_(builder.shl(every_second(0), _each(4, HEX_LANES // 2)), every_second(1))
        which = builder.bitcast(good, ir.IntType(HEX_LANES))
        results = builder.bitcast(pairs, ir.IntType(64)), builder.zext(which, ir.IntType(64))
        return context.make_tuple(builder, signature.return_type, results)

    return returned(content, place), emit


@intrinsic
def first_place(_typing: Any, places: Any) -> tuple[Any, Any]:
    """Return the number of the lowest bit of `places` (uint64) that is set; 64 if none is."""

    def emit(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))

    return types.uint64(places), emit
