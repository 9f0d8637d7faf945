"""Stepwise EM: a mixture goes on learning drive by drive, without the old data (Cappé & Moulines 2009).

What EM needs of the rows it has seen are their sufficient statistics, for each component the mean of the responsibility
ρ, of ρ x and of ρ x xᵀ. After each batch of rows they move towards the batch's own by a step γ,

    s ← (1 − γ) s + γ s̄(batch; θ(s)),        γ_t = t^−κ,    ½ < κ ≤ 1,

and the M step gives the next parameters θ(s). t counts batches, those of the first drive included. κ = 1 gives every
batch the same weight for ever, which comes nearest to the fit of all rows where the first drive was like the others; a
smaller κ forgets what early batches said under parameters that were not right yet, as after a first drive on one kind
of road, and with it the early batches. Memory holds one drive and K matrices however many drives there were.

The statistics are kept as weights, means and covariances of the components, which is the same but does not cancel.

O. Cappé, E. Moulines: On-line expectation-maximization algorithm for latent data models. J. R. Stat. Soc. B 71 (2009).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .estimator import FloatArray, as_rows
from .mixture import GaussianMixture
from .storage import Arrays, Golden, load_model, save_model

KIND = "online_mixture"
GOLDEN_ROWS = 20


@dataclass(frozen=True, slots=True)
class OnlineMixture:
    """Sufficient statistics of all drives so far; `learn` returns those with one drive more.

    Attributes:
        weights: Mean responsibility of each component (k,).
        means: Mean of the rows by responsibility (k, d), in the units of the rows.
        covariances: Their covariance about these means, without regularisation (k, d, d), in products of these units.
        ridge: Added to each covariance's diagonal in `mixture`, (d,), in squares of these units, from the first
            drive's variances.
        rows: Rows seen.
        batch: Rows of a batch.
        exponent: κ of the steps, a pure number.
    """

    weights: FloatArray
    means: FloatArray
    covariances: FloatArray
    ridge: FloatArray
    rows: int
    batch: int
    exponent: float

    @classmethod
    def begin(
        cls,
        first_drive: FloatArray,
        n_components: int,
        *,
        covariance_regularisation: float = 1e-6,
        exponent: float = 0.6,
        batch: int = 200,
        **settings: Any,
    ) -> Self:
        """Fit the first drive by EM in batch; its statistics are Σ ρ/n, Σ ρx/n and Σ ρxxᵀ/n (see the module).

        Args:
            first_drive: Rows (n_rows, d), in any units.
            n_components: K; a component that collapses in the first drive is gone for good.
            covariance_regularisation: As in `GaussianMixture`.
            exponent: κ, a pure number above 0.5 and at most 1. On eight made-up drives of one mixture in unlike shares
                the mean log-likelihood ended below the batch fit's by 0.02 nats with 0.6 and by 0.00 with 1; where a
                component was missing in the first drive, by 0.03 with 0.6 and by 0.47 with 1.
            batch: Rows from which one step is made; as many as tell all components' covariances well.
            settings: Further arguments of `GaussianMixture`.

        Raises:
            ValueError: The exponent or the batch is not usable, or see `GaussianMixture.fit`.
        """
        if not 0.5 < exponent <= 1.0 or batch < 1:
            raise ValueError(
                f"exponent must be above 0.5 and at most 1, batch at least 1; found {exponent!r} and {batch!r}"
            )
        rows = np.asarray(as_rows(first_drive, "first_drive"), dtype=np.float64)
        mixture = GaussianMixture(n_components, covariance_regularisation=covariance_regularisation, **settings).fit(
            rows
        )
        variances = rows.var(axis=0)
        ridge = covariance_regularisation * np.where(variances > 0, variances, 1.0)
        return cls(*_moments(mixture, rows), ridge, len(rows), batch, exponent)

    @property
    def mixture(self) -> GaussianMixture:
        """The mixture that these statistics give, the M step: their weights, means, and covariances + `ridge`."""
        covariances = self.covariances + np.diag(self.ridge)
        return GaussianMixture.from_parameters(self.weights, self.means, covariances)

    def learn(self, drive: FloatArray, seed: int = 0) -> OnlineMixture:
        """Learn from one more drive, by a step of the module's formula for each batch of it.

        Its rows are dealt out to batches at random: rows that follow each other are nearly equal and would pull the
        mixture along the road.

        Args:
            drive: Rows (n_rows, d), in the units of the first drive.
            seed: Of the dealing.

        Raises:
            ValueError: The rows have another number of columns, or missing values.
        """
        rows = np.asarray(as_rows(drive, "drive"), dtype=np.float64)
        if rows.shape[1] != self.means.shape[1]:
            raise ValueError(f"drive has {rows.shape[1]} columns, but {self.means.shape[1]} were learnt so far")
        parts = max(round(len(rows) / self.batch), 1)
        dealt = np.random.default_rng(seed).permutation(np.arange(len(rows)) % parts)
        state: OnlineMixture = self
        for part in range(parts):
            state = state._step(rows[dealt == part])
        return state

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a file has to hold."""
        return {name: np.asarray(getattr(self, name)) for name in self.__slots__}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Return the statistics that `arrays` was taken from."""
        whole = {name: arrays[name] for name in ("weights", "means", "covariances", "ridge")}
        return cls(**whole, rows=int(arrays["rows"]), batch=int(arrays["batch"]), exponent=float(arrays["exponent"]))

    def save(self, folder: Path, card: Mapping[str, Any]) -> list[Path]:
        """Publish the statistics with a model card and golden vectors, as `storage.save_model` does."""
        rows = self.mixture.sample(GOLDEN_ROWS)[0]
        return save_model(folder, KIND, self.arrays(), card, Golden((rows,), _scores(self, rows)))

    @classmethod
    def load(cls, folder: Path) -> tuple[OnlineMixture, dict[str, Any]]:
        """Return what `save` published, and its card; raises InputError as `storage.load_model`."""
        return load_model(folder, {KIND: (_rebuild, _scores)})

    def _step(self, rows: FloatArray) -> OnlineMixture:
        """Return the statistics after one batch."""
        if not len(rows):
            return self
        seen = self.rows + len(rows)
        gain = min(len(rows) / self.batch * (seen / self.batch) ** -self.exponent, 1.0)
        weights, means, covariances = _moments(self.mixture, rows)
        old, new = (1.0 - gain) * self.weights, gain * weights
        total = old + new
        share = (new / total)[:, None]
        shift = means - self.means
        within = (1.0 - share)[..., None] * self.covariances + share[..., None] * covariances
        between = (share * (1.0 - share))[..., None] * shift[:, :, None] * shift[:, None, :]
        return OnlineMixture(
            total, self.means + share * shift, within + between, self.ridge, seen, self.batch, self.exponent
        )


def _moments(mixture: GaussianMixture, rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a batch's mean responsibilities (k,), and by them its means (k, d) and covariances (k, d, d)."""
    responsibilities = mixture.predict_proba(rows)
    counts = responsibilities.sum(axis=0)
    # A component that nothing of the batch belongs to has no moments; whatever stands there has the weight 0.
    by = responsibilities / np.maximum(counts, np.finfo(np.float64).tiny)
    means = by.T @ rows
    covariances = np.empty_like(mixture.covariances_)
    for component, mean in enumerate(means):
        centred = (rows - mean) * np.sqrt(by[:, [component]])
        covariances[component] = centred.T @ centred
    return counts / len(rows), means, covariances


def _rebuild(arrays: Arrays) -> OnlineMixture:
    return OnlineMixture.from_arrays(arrays)


def _scores(state: OnlineMixture, rows: FloatArray) -> tuple[FloatArray]:
    return (state.mixture.score_samples(rows),)
