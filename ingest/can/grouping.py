"""Frames put in the order of their groups, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit


@njit(cache=True, nogil=True)
def by_standard_identifier(
    identifiers: npt.NDArray[np.uint32], extended: npt.NDArray[np.bool_], groups: npt.NDArray[np.uint16]
) -> npt.NDArray[np.uint16]:
    """Return the group of each frame with an 11-bit identifier; the last of `groups`, for none, stands for others.

    Args:
        identifiers: (n,).
        extended: (n,), 29-bit identifier.
        groups: (k + 1,), of the identifiers below k, and of none.
    """
    found, none = np.empty(len(identifiers), np.uint16), np.uint32(len(groups) - 1)
    for k in range(len(identifiers)):
        found[k] = groups[none if extended[k] else min(identifiers[k], none)]
    return found


@njit(cache=True, nogil=True)
def places_by_group(group: npt.NDArray[np.uint16], groups: int) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.intp]]:
    """Return each row's place where one group stands behind the other, and where each group begins there.

    Args:
        group: (n,), below `groups`.
        groups: How many there are.

    Returns:
        (n,), ascending within each group, and (`groups` + 1,).
    """
    begins = np.zeros(groups + 1, np.intp)
    for k in range(len(group)):
        begins[np.intp(group[k]) + 1] += 1
    for number in range(groups):
        begins[number + 1] += begins[number]
    places, following = np.empty(len(group), np.uint32), begins.astype(np.uint32)
    for k in range(len(group)):
        own = np.uint64(group[k])
        places[k] = following[own]
        following[own] += np.uint32(1)
    return places, begins


@njit(cache=True, nogil=True)
def put(values: npt.NDArray[Any], places: npt.NDArray[np.uint32]) -> npt.NDArray[Any]:
    """Return the rows of `values`, each at its place.

    Read from front to back and written to the end of each group they take fewer turns through the caches than rows
    that are fetched from here and there.
    """
    ordered = np.empty_like(values)
    for k in range(len(values)):
        ordered[np.uint64(places[k])] = values[k]
    return ordered
