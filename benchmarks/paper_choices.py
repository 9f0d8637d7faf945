"""What each choice of docs/choices.md changes in numbers, on one test fold of every driver of a project.

python benchmarks/paper_choices.py PROJECT [FOLD]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from wheelprint.modeling.baselines import Ridge
from wheelprint.modeling.drivers import modelled_drivers, one_thread, read_series
from wheelprint.modeling.experiment_cells import WITHIN_68, _columns
from wheelprint.modeling.experiment_models import FUTURE_STEPS, fit_apart, known_lookahead, split_windows
from wheelprint.modeling.lookahead_models import Estimate, GeneralLookahead
from wheelprint.modeling.mixture import GaussianMixture
from wheelprint.modeling.motion_primitives import TOLERANCE, fit_motion_primitives
from wheelprint.modeling.regression import MixtureRegression
from wheelprint.schemas.project import Project

ESTIMATES: tuple[Estimate, ...] = ("mean", "mode")


def main(folder: Path, fold: int) -> None:
    """Print a table for each driver."""
    project = Project(folder)
    for driver in modelled_drivers(project)[0]:
        print(f"{driver}, test fold {fold}")
        with one_thread():
            motion_primitives(project, driver, fold)
            lookahead(project, driver, fold)


def motion_primitives(project: Project, driver: str, fold: int) -> None:
    """MP: eqs. 20 and 22, the future path, n₂ = −1, shrinkage, types apart, raw features, what var averages."""
    config = project.config
    series = read_series(project.directory, driver, config)

    def tell(what: str, error: np.ndarray, variance: np.ndarray) -> None:
        sd = np.sqrt(variance)
        print(
            f"  {what:58} error {np.abs(error).mean():7.3f} deg, mean variance {variance.mean():8.2f} deg², "
            f"68 % band covers {100 * np.mean(np.abs(error) <= WITHIN_68 * sd):4.1f} %"
        )

    split = split_windows(project.directory, driver, series, fold, 1, config, faithful=False)
    learnt, asked = split.learnt, split.asked
    joint = np.concatenate([learnt.inputs, learnt.outputs], axis=1)
    mixture = GaussianMixture(9, max_iterations=100, tolerance=TOLERANCE, random_state=0).fit(joint)
    split_at = (range(learnt.inputs.shape[1]), range(learnt.inputs.shape[1], joint.shape[1]))
    corrected = MixtureRegression.from_mixture(mixture, *split_at)
    printed = MixtureRegression.from_mixture(mixture, *split_at, faithful=True)
    mean, sd = corrected.predict(asked.inputs, return_sd=True)
    tell("n₁ = 1, n₄ = 9: posterior, law of total covariance", mean - asked.outputs, sd**2)
    beta = corrected.responsibilities(asked.inputs)
    own = np.diagonal(corrected.conditional_covariances_, axis1=1, axis2=2)
    tell("  eq. 22 alone (Σ β² C)", mean - asked.outputs, beta**2 @ own)
    printed_mean, printed_sd = printed.predict(asked.inputs, return_sd=True)
    tell("  eqs. 20 and 22", printed_mean - asked.outputs, printed_sd**2)
    mixed = beta.max(axis=1) < 0.9
    print(f"  windows whose components mix (no β above 0.9): {100 * mixed.mean():.1f} %")
    if mixed.any():
        tell("    of these: law of total covariance", (mean - asked.outputs)[mixed], sd[mixed] ** 2)
        tell("    of these: eq. 22 alone", (mean - asked.outputs)[mixed], (beta**2 @ own)[mixed])
        tell("    of these: eqs. 20 and 22", (printed_mean - asked.outputs)[mixed], printed_sd[mixed] ** 2)
    every = {
        "mean over windows and steps": (sd**2).mean(),
        "the last step, 5 s ahead": (sd[:, -1] ** 2).mean(),
        "the first step, 0.1 s ahead": (sd[:, 0] ** 2).mean(),
        "square of the mean deviation": sd.mean() ** 2,
        "mean square error": np.square(mean - asked.outputs).mean(),
    }
    print("  var as", "; ".join(f"{name}: {value:.2f}" for name, value in every.items()), "deg²")

    for past_steps, path in ((1, True), (1, False), (0, True), (-1, True)):
        split = split_windows(project.directory, driver, series, fold, past_steps, config, faithful=False)
        columns = _columns(past_steps, future_path=path)
        inputs, seen = split.learnt.inputs[:, columns], split.asked.inputs[:, columns]
        penalty = Ridge.fit(inputs, split.learnt.outputs, gap=max(past_steps, 0) + FUTURE_STEPS).penalty
        fit = fit_motion_primitives(
            inputs, split.learnt.outputs, split.learnt_types, n1=27, components=3, shrinkage=penalty
        )
        mean, variance = fit.predict(seen, split.asked_types)
        told = "" if path else ", without the path ahead (eq. 2)"
        tell(f"n₁ = 27, n₂ = {past_steps}, n₄ = 3{told}", mean - split.asked.outputs, variance)
    for faithful, told in ((False, "logarithms"), (True, "features as they are")):
        split = split_windows(project.directory, driver, series, fold, 1, config, faithful=faithful)
        fit = fit_apart(split.learnt.inputs, split.learnt.outputs, split.learnt_types, 3, 0)
        mean, variance = fit.predict(split.asked.inputs, split.asked_types)
        tell(f"n₁ = 27, n₂ = 1, n₄ = 3, types apart, as printed, {told}", mean - split.asked.outputs, variance)


def lookahead(project: Project, driver: str, fold: int) -> None:
    """PP: arg max against mean, and what eq. 8 charges."""
    config = project.config
    series = read_series(project.directory, driver, config)
    inputs, distance, training, test = known_lookahead(project.directory, driver, series, fold, config)
    model = GeneralLookahead(12, starts=3).fit(inputs[training], distance[training])
    for estimate in ESTIMATES:
        model.estimate = estimate
        found, sd = model.predict(inputs[test])
        error = found - distance[test]
        print(
            f"  lookahead, N = 12, {estimate}: mean error {np.abs(error).mean():.3f} m, root mean square "
            f"{np.sqrt(np.square(error).mean()):.3f} m, mean standard deviation {sd.mean():.3f} m"
        )
    beta = model.regression.responsibilities(inputs[test])
    print(f"  eq. 11 as printed is a responsibility: the largest one is {beta.max(axis=1).mean():.3f} on average")
    joint = np.column_stack([inputs, distance])[training]
    bic: dict[str, list[tuple[float, int]]] = {"full": [], "paper": []}
    for components in (3, 6, 12, 20):
        mixture = GaussianMixture(components, random_state=0).fit(joint)
        bic["full"].append((mixture.bic(joint), components))
        bic["paper"].append((mixture.bic(joint, "paper"), components))
    print("  BIC chooses of N = 3, 6, 12, 20:", {count: min(of)[1] for count, of in bic.items()})


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
