"""A bound on the loss, and when it may be relied on."""

import math
from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.risk import (
    RiskConfig,
    min_ess,
    spend,
    upper_bound_rank,
    value_at_risk,
    var_upper_bound,
)

MAX_RHAT = 1.01
"""Chains of a larger R-hat forbid a certificate, whatever they were asked for."""

MIN_SHARE = 0.95
"""Less of the likeliest model, where several were weighed, forbids a certificate: evidence
is known to some tenths of a nat alone."""

MIN_FIT = 0.05
"""A p-value of the demonstrations' fit below this forbids a certificate."""


@dataclass(frozen=True)
class Bound:
    r"""How much the robot may lose, in the worst of the situations it will meet.

    In each of T situations the loss of the robot's guess is at most `value` with
    posterior probability :math:`\alpha`. Monte Carlo error makes this fail with
    probability `delta` at most: the situation of the largest VaR is a fixed one, and
    its own bound holds with that confidence.

    Attributes:
        value: Largest upper confidence bound of the VaR; infinite if there are too few
            effective samples.
        var: Largest VaR, as estimated.
        alpha: Quantile.
        delta: Share of the risk of Monte Carlo error spent on this look.
        look: Which look at the bound this is, from 1.
        num_draws: Effective number of independent draws.
        rank: Order of the draw that is the bound; None if there are too few.
        num_situations: T.
    """

    value: float
    var: float
    alpha: float
    delta: float
    look: int
    num_draws: int
    rank: int | None
    num_situations: int

    @classmethod
    def of_losses(
        cls, losses: Array, ess: float, risk: RiskConfig, look: int
    ) -> "Bound":
        """Bound losses, shape (T, N), at one of many looks at them.

        Args:
            losses: Loss of the guess in each situation under each sample.
            ess: Independent draws that the samples are worth.
            risk: Quantile, and the risk of Monte Carlo error over all looks.
            look: Which look this is, from 1.
        """
        delta = spend(risk.delta, look)
        num_draws = math.floor(min(ess, losses.shape[-1]))
        bounds = var_upper_bound(losses, risk.alpha, delta, ess=max(ess, 1.0))
        return cls(
            value=float(bounds.max()),
            var=float(value_at_risk(losses, risk.alpha).max()),
            alpha=risk.alpha,
            delta=delta,
            look=look,
            num_draws=num_draws,
            rank=upper_bound_rank(max(num_draws, 1), risk.alpha, delta),
            num_situations=int(np.prod(losses.shape[:-1])),
        )


def has_mixed(posterior: Posterior) -> bool:
    """Tell whether chains are fit for a certificate, whatever they were asked for."""
    return posterior.is_sound and posterior.rhat <= MAX_RHAT


def doubts(bound: Bound, epsilon: float, posterior: Posterior, fit: float) -> list[str]:
    """Say why the loss cannot be certified to be below epsilon; nothing if it can.

    Args:
        bound: The bound over the situations of the deployment.
        epsilon: What the loss is to be below.
        posterior: The posterior that the bound is of.
        fit: P-value of the demonstrations under the model of the person.

    Returns:
        Reasons, in words.
    """
    found = []
    if not bound.value < epsilon:
        found.append(f"the bound, {bound.value:.4f}, is not below epsilon, {epsilon:g}")
    least = min_ess(bound.alpha, bound.delta)
    if bound.rank is None:
        found.append(
            f"the effective sample size, {bound.num_draws}, is below {least}, the "
            f"least for alpha {bound.alpha:g} at delta {bound.delta:.3g}"
        )
    if not has_mixed(posterior):
        found.append(
            f"the chains have not mixed: effective sample size {posterior.ess:.0f}, "
            f"R-hat {posterior.rhat:.3f} (at most {MAX_RHAT:g})"
            + ("" if posterior.is_sound else " when their steps were spent")
        )
    if posterior.shares and max(posterior.shares.values()) < MIN_SHARE:
        found.append(
            "which model of the person holds is open: "
            + ", ".join(
                f"{name} {share:.2f}" for name, share in posterior.shares.items()
            )
            + f" (one must have {MIN_SHARE:g})"
        )
    if not fit >= MIN_FIT:
        found.append(
            "the demonstrations do not fit the model of the person: such as these come "
            f"with a probability of {fit:.3g}, below {MIN_FIT:g}"
        )
    return found
