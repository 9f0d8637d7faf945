"""Eight bytes at any place as one number, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import intrinsic


@intrinsic
def word_at(_typing: Any, content: Any, place: Any) -> tuple[Any, Any]:
    """Return the eight bytes of `content` (uint8, contiguous) from `place` (uint64) on, the first one the lowest."""

    def load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        octets = context.make_array(signature.args[0])(context, builder, arguments[0])
        first = builder.gep(octets.data, [arguments[1]])
        word = context.get_value_type(signature.return_type)
        return builder.load(builder.bitcast(first, word.as_pointer()), align=1)

    return types.uint64(content, place), load
