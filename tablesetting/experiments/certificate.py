"""What a run can be relied on for, as certificate.json has it."""

import hashlib
import json
from typing import Any

from tablesetting.experiments.learning import LearningRound
from tablesetting.irl.certificate import has_mixed
from tablesetting.results import finite_or_none, package_versions
from tablesetting.reward.config import PlacementConfig
from tablesetting.reward.files import demonstrations_to_json

CERTIFICATE_FORMAT = "tablesetting-certificate/1"


def certificate_to_json(latest: LearningRound) -> dict[str, Any]:
    """Return the content of certificate.json for the last round of a run."""
    setup, bound = latest.setup, latest.bound
    problem, posterior = setup.problem, latest.learning.posterior
    config = problem.config
    claim = (
        f"in each of {bound.num_situations} layouts, the place where the robot thinks "
        "that the item is wanted is less than epsilon from where it is, with posterior "
        f"probability {bound.alpha:g} at least; Monte Carlo error makes that wrong in a "
        f"share {config.risk.delta:g} of runs at most, it is only as true as the model "
        "of the person, and it speaks of wishes, whatever stands in their way"
    )
    return {
        "format": CERTIFICATE_FORMAT,
        "certified": not latest.doubts,
        "doubts": latest.doubts,
        "claim": None if latest.doubts else claim,
        "task": problem.task.name,
        "epsilon": setup.epsilon,
        "bound": finite_or_none(bound.value),
        "var": bound.var,
        "alpha": bound.alpha,
        "delta": config.risk.delta,
        "spending": {
            "rule": "delta / (look (look + 1))",
            "look": bound.look,
            "delta": bound.delta,
        },
        "order": {"rank": bound.rank, "of": bound.num_draws},
        "layouts": {
            "distribution": setup.distribution,
            "count": bound.num_situations,
            "sha256": hashlib.sha256(
                setup.deployment.astype("<f8").tobytes()
            ).hexdigest(),
        },
        "sampler": {
            "num_samples": len(posterior.weights),
            "bulk_ess": posterior.diagnosis.bulk_ess,
            "tail_ess": posterior.diagnosis.tail_ess,
            "rhat": finite_or_none(posterior.diagnosis.rhat),
            "kept_ess": posterior.kept_ess,
            "has_mixed": has_mixed(posterior),
            "target_ess": config.mcmc.target_ess,
            "max_rhat": config.mcmc.max_rhat,
        },
        "model": {
            "likelihood": config.likelihood,
            "shares": dict(posterior.shares),
            "guess": posterior.guess,
            **_scales(config),
        },
        "fit": {
            "p_value": latest.fit.p_value,
            "explained": latest.fit.explained,
            "foretold": list(latest.fit.foretold),
        },
        "demonstrations": {
            "count": latest.num_demos,
            "sha256": hash_demonstrations(latest),
        },
        "versions": package_versions(),
    }


def hash_demonstrations(latest: LearningRound) -> str:
    """Hash what demonstrations.json holds, without white space, keys in order."""
    content = demonstrations_to_json(latest.learning.demos, latest.setup.problem.task)
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _scales(config: PlacementConfig) -> dict[str, float]:
    """Return how exact the person is thought to be, by the models that are used."""
    scales: dict[str, float] = {}
    if config.likelihood != "placement":
        scales |= {
            "beta": config.boltzmann.beta,
            "beta_spread": config.boltzmann.beta_spread,
        }
    if config.likelihood != "boltzmann":
        scales |= {
            "noise_std": config.noise.noise_std,
            "noise_spread": config.noise.noise_spread,
        }
    return scales
