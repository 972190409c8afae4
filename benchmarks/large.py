"""Measure a query of 5000 layouts under 10000 samples; print its cost as JSON.

In a process of its own, so that its most memory is that of this work alone.
"""

import json
import resource
from dataclasses import replace
from functools import partial

from cases import demonstrations, make_rng, weigh_queries
from figure import cpu_seconds

from tablesetting.reward.config import PAPER
from tablesetting.reward.problem import PlacementProblem
from tablesetting.reward.tasks import VASE

_NUM_LAYOUTS = 5000
_NUM_SAMPLES = 10000


def main() -> None:
    mcmc = replace(PAPER.mcmc, num_steps=25 * _NUM_SAMPLES, num_samples=_NUM_SAMPLES)
    config = replace(PAPER, mcmc=mcmc, num_candidates=_NUM_LAYOUTS)
    problem = PlacementProblem(VASE, config)
    demos = demonstrations(problem, 5)  # Also loads the kernel that is timed.
    posterior = problem.infer(demos, None, rng=make_rng())
    seconds = cpu_seconds(partial(weigh_queries, problem, demos, posterior))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # From [KiB].
    print(json.dumps({"seconds": seconds, "resident_mib": peak}))


if __name__ == "__main__":
    main()
