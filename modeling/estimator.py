"""The part of scikit-learn's estimator protocol that `clone` and the model selection tools need, without its import."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from functools import cache
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class RowSource(ABC):
    """Rows that are made when they are asked for: `fit` takes one wherever an array would not fit into memory.

    Attributes:
        shape: (n_samples, n_features).
    """

    shape: tuple[int, int]

    @abstractmethod
    def __getitem__(self, index: slice | npt.NDArray[np.intp]) -> FloatArray:
        """Return some of the rows, all of them finite, (n, n_features), in any units."""

    def __len__(self) -> int:
        return self.shape[0]


Rows = npt.NDArray[np.floating[Any]] | RowSource


class Estimator:
    """Parameters by name, as in scikit-learn: the constructor stores its arguments untouched, `fit` checks them.

    Importing scikit-learn takes seconds, so nothing is inherited from it; `sklearn.base.clone` only asks for
    `get_params` and such a constructor.
    """

    _estimator_type: ClassVar[str]

    n_features_in_: int

    @classmethod
    @cache
    def _parameter_names(cls) -> list[str]:
        return list(inspect.signature(cls).parameters)

    def get_params(self, deep: bool = True) -> dict[str, Any]:  # noqa: ARG002 - no estimator here nests another
        """Return the constructor's arguments by name."""
        return {name: getattr(self, name) for name in self._parameter_names()}

    def set_params(self, **parameters: Any) -> Self:
        """Change constructor arguments by name.

        Raises:
            ValueError: A name is not one of the constructor's.
        """
        known = self._parameter_names()
        unknown = [name for name in parameters if name not in known]
        if unknown:
            raise ValueError(
                f"{type(self).__name__} has no parameter {', '.join(unknown)}; its parameters are {', '.join(known)}"
            )
        for name, value in parameters.items():
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        arguments = ", ".join(f"{name}={value!r}" for name, value in self.get_params().items())
        return f"{type(self).__name__}({arguments})"

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import RegressorTags, Tags, TargetTags

        regresses = self._estimator_type == "regressor"
        return Tags(
            estimator_type=self._estimator_type,
            target_tags=TargetTags(required=regresses, multi_output=regresses, single_output=True),
            regressor_tags=RegressorTags() if regresses else None,
        )

    def _require_fit(self, attribute: str) -> None:
        if not hasattr(self, attribute):
            from sklearn.exceptions import NotFittedError

            raise NotFittedError(f"this {type(self).__name__} is not fitted yet; call `fit` first")

    def _rows(self, X: npt.ArrayLike) -> npt.NDArray[np.floating[Any]]:
        """Return rows that a fitted estimator can be asked about."""
        rows = as_array(X, "X")
        if rows.shape[1] != self.n_features_in_:
            raise ValueError(
                f"X has {rows.shape[1]} features, but {type(self).__name__} is expecting {self.n_features_in_} "
                "features as input"
            )
        return rows


def as_rows(values: npt.ArrayLike | RowSource, name: str) -> Rows:
    """Return a source of rows as it is, and anything else as `as_array` does; see there."""
    return values if isinstance(values, RowSource) else as_array(values, name)


def as_sample_weights(values: npt.ArrayLike | None, n: int) -> FloatArray | None:
    """Return weights of n rows (n,), w_i n / Σ w: 1 on average; None for None.

    Raises:
        ValueError: They have another shape, one is negative or not finite, or all are zero.
    """
    if values is None:
        return None
    weights = np.array(values, dtype=np.float64)
    if weights.ndim != 1:
        raise ValueError(f"Sample weights must be 1D array or scalar, found shape {weights.shape}")
    if len(weights) != n:
        raise ValueError(f"sample_weight.shape == {weights.shape}, expected ({n},)!")
    if not np.isfinite(weights).all() or (weights < 0).any() or not weights.any():
        raise ValueError("sample_weight must be finite, zero or positive, and not zero everywhere")
    normalised: FloatArray = weights * (n / weights.sum())
    return normalised


def as_array(values: npt.ArrayLike, name: str) -> npt.NDArray[np.floating[Any]]:
    """Return `values` as a finite array of shape (n_samples, n_features) in its units, float32 and float64 uncopied.

    Args:
        values: Whatever numpy can read as an array of real numbers (n_samples, n_features), in any units.
        name: What an error calls it.

    Raises:
        ValueError: It has another shape, or holds NaN, infinite or complex values.
        TypeError: It is a sparse matrix.
    """
    if hasattr(values, "tocsr"):
        raise TypeError(f"{name} is sparse, and sparse input is not supported; convert it by `.toarray()`")
    array = np.asarray(values)
    if array.dtype.kind == "c":
        raise ValueError(f"Complex data not supported: {name} has type {array.dtype}")
    if array.dtype not in (np.float32, np.float64):
        array = array.astype(np.float64)
    if array.ndim != 2:
        raise ValueError(
            f"Expected 2D array, got {array.ndim}D array instead: {name} must have the shape (n_samples, n_features). "
            "Reshape your data either using array.reshape(-1, 1) if it has a single feature or array.reshape(1, -1) "
            "if it is a single sample"
        )
    if array.shape[1] == 0:
        raise ValueError(f"{name} has 0 feature(s) (shape={array.shape}) while a minimum of 1 is required.")
    with np.errstate(all="ignore"):
        total = array.sum(axis=0, dtype=np.float64)
    if not np.isfinite(total).all():
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        if bad.size:
            raise ValueError(
                f"{name} contains NaN or infinity in {bad.size} of {array.shape[0]} rows, the first is row {bad[0]}; "
                "leave rows with missing values out"
            )
    return array
