"""In which order inputs are whitened where components are dismissed before all of their inputs are looked at."""

from __future__ import annotations

import numpy as np

from .estimator import FloatArray
from .windows import Rows


def telling_first(covariances: FloatArray) -> Rows:
    """Return the inputs in an order in which a few of them nearly say how probable each component is.

    One after the other that input is taken whose variances v_k, given those taken before, differ most among the
    components: log(Σ v_k / k) − Σ log v_k / k is largest. Taking input j leaves Σ − Σ_·j Σ_j· / Σ_jj of each.

    Args:
        covariances: Of the inputs (k, n, n), positive definite, in any units.

    Returns:
        Shape (n,).
    """
    left = covariances.copy()
    order: list[int] = []
    remaining = np.arange(covariances.shape[1])
    while len(remaining):
        variances = np.maximum(np.diagonal(left, axis1=1, axis2=2)[:, remaining], np.finfo(np.float64).tiny)
        differs = np.log(variances.mean(axis=0)) - np.log(variances).mean(axis=0)
        best = int(remaining[np.argmax(np.round(differs, 9))])
        order.append(best)
        remaining = remaining[remaining != best]
        left -= left[:, :, [best]] * left[:, [best], :] / left[:, [best]][:, :, [best]]
    return np.array(order, dtype=np.intp)


def spread(n: int) -> Rows:
    """Return columns 0 to n − 1 in an order in which the first few, however many, lie evenly among all.

    Where neighbours resemble each other, as in windows of a series, a few of them then tell nearly as much as in
    `telling_first`, and nothing has to be known of them. It is the order of numbers whose binary digits are reversed.
    """
    bits = max(n - 1, 1).bit_length()
    places = (int(f"{number:0{bits}b}"[::-1], 2) for number in range(1 << bits))
    return np.array([place for place in places if place < n], dtype=np.intp)
