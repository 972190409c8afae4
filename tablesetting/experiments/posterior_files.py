"""A posterior on the disk."""

from pathlib import Path

import numpy as np

from tablesetting.irl.posterior import Posterior


def save_posterior(path: Path, posterior: Posterior) -> None:
    """Write samples, guesses and diagnostics as posterior.npz."""
    np.savez(
        path,
        weights=posterior.weights,
        log_posts=posterior.log_posts,
        map_weights=posterior.map_weights,
        mean_weights=posterior.mean_weights,
        guessed_weights=posterior.guessed_weights,
        scales=np.empty(0) if posterior.scales is None else posterior.scales,
        num_chains=posterior.num_chains,
        acceptance_rate=posterior.acceptance_rate,
        ess=posterior.ess,
        bulk_ess=posterior.diagnosis.bulk_ess,
        tail_ess=posterior.diagnosis.tail_ess,
        rhat=posterior.rhat,
        log_evidence=posterior.log_evidence,
    )
