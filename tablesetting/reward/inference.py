"""From demonstrations to the posterior of the weights, by a model of the demonstrator."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import (
    Guess,
    Posterior,
    infer_posterior,
    mix_posteriors,
)
from tablesetting.irl.sampler import LogDensity
from tablesetting.reward.config import ModelName, PlacementConfig
from tablesetting.reward.likelihood import BoltzmannLikelihood, Demonstration
from tablesetting.reward.placement_likelihood import PlacementLikelihood

_Model = BoltzmannLikelihood | PlacementLikelihood
_Builder = Callable[[Sequence[Demonstration], Array, PlacementConfig], _Model]

MODELS: dict[ModelName, _Builder] = {
    "boltzmann": lambda demos, widths, config: BoltzmannLikelihood(
        demos, widths, config.boltzmann
    ),
    "placement": lambda demos, widths, config: PlacementLikelihood(
        demos, widths, config.noise
    ),
}
"""Models of the demonstrator, by name."""

# Boltzmann's mean is drawn to the middle by what is left open; the maximum of the
# placement likelihood is flat.
_BETTER_GUESS: dict[ModelName, Guess] = {"boltzmann": "map", "placement": "mean"}

_PRICES = {"boltzmann": 0.0, "placement": 1.75}  # [nats per demonstration]


def infer_weights(
    demos: Sequence[Demonstration],
    widths: Array,
    config: PlacementConfig,
    *,
    previous_map: Array | None = None,
    log_prior: LogDensity | None = None,
    rng: np.random.Generator,
) -> Posterior:
    """Sample the posterior of the weights given the demonstrations.

    Args:
        demos: At least one demonstration.
        widths: Width of each RBF, shape (D,), in squared table units.
        config: The model of the demonstrator, and how to sample.
        previous_map: MAP before the last demonstration, shape (D,), where chains start
            in the paper's setting.
        log_prior: Log density of the prior of weights; uniform if None.
        rng: Source of all randomness.

    Returns:
        The posterior; under `auto` the mixture of both models.
    """
    names = tuple(MODELS) if config.likelihood == "auto" else (config.likelihood,)
    posteriors: dict[str, Posterior] = {
        name: infer_posterior(
            MODELS[name](demos, widths, config),
            len(widths),
            config.mcmc,
            previous_map=previous_map,
            log_prior=log_prior,
            guess=config.guess or _BETTER_GUESS[name],
            rng=rng,
        )
        for name in names
    }
    if config.likelihood != "auto":
        return posteriors[config.likelihood]
    return mix_posteriors(posteriors, model_shares(posteriors, len(demos)))


def model_shares(
    posteriors: Mapping[str, Posterior], num_demos: int
) -> dict[str, float]:
    """Weigh models of the demonstrator by their evidence.

    The one of exact placements has to earn its sharpness: each demonstration must be
    more likely under it by a fixed factor before it counts for it. With equal odds it
    would win while the Boltzmann MAP is still closer to what is wanted.

    Args:
        posteriors: Posterior under each model, by name.
        num_demos: Number of demonstrations.

    Returns:
        Shares that add up to 1.
    """
    evidence = np.array(
        [
            each.log_evidence - num_demos * _PRICES[name]
            for name, each in posteriors.items()
        ]
    )
    shares = np.exp(evidence - evidence.max())
    return dict(zip(posteriors, (shares / shares.sum()).tolist(), strict=True))
