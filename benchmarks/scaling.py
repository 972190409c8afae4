"""How the cost of the paper's pieces grows with the size of the problem."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from cases import NUM_CANDIDATES, NUM_REWARDS, make_rng
from figure import Figure, Plain, Quantity, Work, measure, summarize
from plain_work import plain_chain, plain_placements

from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import Posterior, infer_posterior
from tablesetting.irl.sampler import sample_uniform_weights
from tablesetting.reward.config import PAPER
from tablesetting.reward.likelihood import BoltzmannLikelihood, Demonstration
from tablesetting.reward.placement import best_placements
from tablesetting.reward.rbf import RbfWidths

_NUM_OBJECTS = (4, 8, 16, 32, 64)
_NUM_DEMOS = (1, 10, 100)
_NUM_SAMPLES = (100, 1000, 10000)
_NUM_LAYOUTS = (50, 500, 5000)


def chains() -> Iterator[Figure]:
    """The chain of 2500 steps; 4 objects and 5 demonstrations unless said otherwise."""
    yield from _series("objects, chain", _NUM_OBJECTS, lambda n: _chain(num_objects=n))
    yield from _series("demos, chain", _NUM_DEMOS, lambda n: _chain(num_demos=n))


def many_placements() -> Iterator[Figure]:
    """Placements of 100 samples in 50 layouts of 4 objects, unless said otherwise."""
    for name, sizes, prepare in (
        ("objects", _NUM_OBJECTS, lambda n: _placements(num_objects=n)),
        ("samples", _NUM_SAMPLES, lambda n: _placements(num_samples=n)),
        ("layouts", _NUM_LAYOUTS, lambda n: _placements(num_layouts=n)),
    ):
        yield from _series(f"{name}, placements", sizes, prepare)


def large() -> Iterator[Figure]:
    """A query of 5000 layouts under 10000 samples, in a process of its own."""
    command = [sys.executable, str(Path(__file__).with_name("large.py"))]
    printed = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
    cost = json.loads(printed)
    yield summarize(
        "query of 5000 layouts x 10000 samples, whole process",
        [cost["seconds"]],
        peak_mib=cost["resident_mib"],
    )


FIGURES: tuple[Callable[[], Iterator[Figure]], ...] = (chains, many_placements, large)


def _series(
    name: str, sizes: Sequence[int], prepare: Callable[[int], tuple[Work, Plain]]
) -> Iterator[Figure]:
    """Time the work of every size, and how much faster than the size its cost grows."""
    seconds = []
    for size in sizes:
        work, plain = prepare(size)
        timing = measure(f"{size} {name}", work, plain=plain, traces_memory=True)
        seconds.append(timing.seconds_min)
        yield timing
    growth = seconds[-1] / seconds[0] / (sizes[-1] / sizes[0])
    yield Quantity(f"growth of cost / growth of {name}", growth, "(1: linear)")


def _chain(*, num_objects: int = 4, num_demos: int = 5) -> tuple[Work, Plain]:
    """Prepare the inference of a random preference from random layouts."""
    widths = RbfWidths().per_center(num_objects)
    demos = _random_demos(num_objects, num_demos)
    return partial(_infer, demos, widths), plain_chain(
        demos, widths, PAPER.boltzmann, PAPER.mcmc
    )


def _placements(
    *, num_objects: int = 4, num_samples: int = 100, num_layouts: int = 50
) -> tuple[Work, Plain]:
    """Prepare the placements of posterior samples in random layouts."""
    widths = RbfWidths().per_center(num_objects)
    posterior = _infer(_random_demos(num_objects, 5), widths, num_samples)
    weights = posterior.weights
    layouts = make_rng().random((num_layouts, num_objects, 2))
    some, few = weights[-NUM_REWARDS:], layouts[:NUM_CANDIDATES]
    return partial(best_placements, weights, layouts, widths), Plain(
        partial(plain_placements, some, few, widths),
        share=len(some) * len(few) / (num_samples * num_layouts),
    )


def _random_demos(num_objects: int, num_demos: int) -> list[Demonstration]:
    """Show where a random preference wants the item in random layouts."""
    rng, widths = np.random.default_rng(1), RbfWidths().per_center(num_objects)
    true_weights = sample_uniform_weights(1, len(widths), rng=rng)
    layouts = rng.random((num_demos, num_objects, 2))
    placements = best_placements(true_weights, layouts, widths)[:, 0]
    return [
        Demonstration(layout, placement)
        for layout, placement in zip(layouts, placements, strict=True)
    ]


def _infer(
    demos: Sequence[Demonstration], widths: Array, num_samples: int = NUM_REWARDS
) -> Posterior:
    """Run the paper's chain for a number of samples."""
    return infer_posterior(
        BoltzmannLikelihood(demos, widths, PAPER.boltzmann),
        len(widths),
        replace(PAPER.mcmc, num_steps=25 * num_samples, num_samples=num_samples),
        previous_map=None,
        rng=make_rng(),
    )
