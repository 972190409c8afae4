"""From demonstrations to the posterior of the weights, by a model of the demonstrator."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import softmax

from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import (
    Guess,
    Posterior,
    infer_posterior,
    mix_posteriors,
)
from tablesetting.irl.sampler import LogDensity, McmcConfig
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

_PRICE = 1.2  # Of a guess by `placement` [nats per demonstration].

# The evidence of fewer is off by some nats, which is more than models may differ by.
_NUM_PARTICLES, _STEPS_PER_RUNG = 256, 10


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

    def infer(name: ModelName, mcmc: McmcConfig) -> Posterior:
        return infer_posterior(
            MODELS[name](demos, widths, config),
            len(widths),
            mcmc,
            previous_map=previous_map,
            log_prior=log_prior,
            guess=config.guess or _BETTER_GUESS[name],
            rng=rng,
        )

    if config.likelihood != "auto":
        return infer(config.likelihood, config.mcmc)
    thorough = replace(
        config.mcmc,
        num_particles=max(config.mcmc.num_particles, _NUM_PARTICLES),
        steps_per_rung=max(config.mcmc.steps_per_rung, _STEPS_PER_RUNG),
    )
    posteriors: dict[str, Posterior] = {name: infer(name, thorough) for name in MODELS}
    guess_of = model_to_guess_by(posteriors, len(demos))
    return mix_posteriors(posteriors, model_shares(posteriors), guess_of)


def model_shares(posteriors: Mapping[str, Posterior]) -> dict[str, float]:
    """Weigh models of the demonstrator by their evidence, at equal prior odds.

    Args:
        posteriors: Posterior under each model, by name.

    Returns:
        Probabilities, which add up to 1.
    """
    evidence = np.array([each.log_evidence for each in posteriors.values()])
    return dict(zip(posteriors, softmax(evidence).tolist(), strict=True))


def model_to_guess_by(posteriors: Mapping[str, Posterior], num_demos: int) -> str:
    """Choose the model whose guess the robot acts on.

    The better model need not guess better while little is known: Boltzmann's MAP is
    sparse, as what people want often is. So `placement` guesses once its evidence is
    ahead by a fixed factor per demonstration, which was chosen on the two tasks.

    Args:
        posteriors: Posteriors under both models, by name.
        num_demos: Number of demonstrations.

    Returns:
        The name.
    """
    lead = posteriors["placement"].log_evidence - posteriors["boltzmann"].log_evidence
    return "placement" if lead > _PRICE * num_demos else "boltzmann"
