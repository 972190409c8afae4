"""A placement task as a problem that the active loop can learn."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.sampler import LogDensity
from tablesetting.reward.climb import climb
from tablesetting.reward.config import DEFAULT, PAPER, PlacementConfig
from tablesetting.reward.inference import MODELS, infer_weights
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.outlook import PlacementOutlook, placement_losses
from tablesetting.reward.placement import best_placements
from tablesetting.reward.rbf import all_centers, rbf_features
from tablesetting.reward.tasks import VASE, PlacementTask
from tablesetting.reward.teachers import ExactTeacher, Teacher


class PlacementProblem:
    """Where a person wants an item: implements `irl.active.Problem`.

    Queries are layouts, shape (K, 2) in table units; answers are `Demonstration`.
    """

    def __init__(
        self,
        task: PlacementTask,
        config: PlacementConfig,
        *,
        teacher: Teacher | None = None,
        candidates: Array | None = None,
        deployment: Array | None = None,
        log_prior: LogDensity | None = None,
    ):
        """Set up the problem.

        Args:
            task: Objects, item and true weights.
            config: How to learn.
            teacher: The simulated person who has these weights; exact if None.
            candidates: The layouts that can be asked about, shape (Q, K, 2); drawn as
                `config` says if None.
            deployment: Layouts such as the robot will meet, shape (T, K, 2), which
                some strategies think ahead to; those candidates if None.
            log_prior: Log density of the prior of weights; uniform if None.
        """
        if log_prior is not None and config.likelihood == "auto":
            raise ValueError(
                "`log_prior` goes with one likelihood: the evidence that auto weighs is "
                "that under the uniform prior"
            )
        if log_prior is not None and config.noise.noise_spread > 0.0:
            raise ValueError(
                "`log_prior` goes with a fixed noise, whose steps are reversible; got "
                f"`noise_spread` {config.noise.noise_spread}"
            )
        self.task = task
        self.config = config
        self.teacher: Teacher = teacher or ExactTeacher()
        self._candidates = candidates
        self._deployment = deployment
        self._log_prior = log_prior
        self.space = LayoutSpace.of_task(task, are_points=config.are_points)
        self.widths = config.widths.per_center(len(task.objects))

    def infer(
        self,
        demos: Sequence[Demonstration],
        previous: Posterior | None,
        *,
        rng: np.random.Generator,
    ) -> Posterior:
        """Sample the posterior of the weights given the demonstrations."""
        return infer_weights(
            demos,
            self.widths,
            self.config,
            previous_map=None if previous is None else previous.map_weights,
            log_prior=self._log_prior,
            rng=rng,
        )

    def propose_queries(
        self,
        demos: Sequence[Demonstration],
        posterior: Posterior | None = None,
        *,
        rng: np.random.Generator,
    ) -> list[Array]:
        """Draw candidate layouts, each of shape (K, 2), or return those given.

        The posterior, which other domains need, changes nothing here.
        """
        if self._candidates is not None:
            return list(self._candidates)
        num_layouts = self.config.num_candidates
        if self.config.candidates == "any":
            return list(self.space.sample(num_layouts, rng=rng))
        last = demos[-1].layout
        return list(self.space.sample_one_moved(last, num_layouts, rng=rng))

    def outlook(
        self, queries: Sequence[Array], posterior: Posterior
    ) -> PlacementOutlook:
        """Return what the posterior says of the candidates."""
        layouts = np.asarray(queries)
        deployment = layouts if self._deployment is None else self._deployment
        return PlacementOutlook(
            layouts, deployment, posterior, self.widths, self.config
        )

    def policy_losses(self, queries: Sequence[Array], posterior: Posterior) -> Array:
        """Return the distances between the placements of the guess and of each sample.

        The loss of the paper's table task, shape (Q, N), in table units.
        """
        return placement_losses(np.asarray(queries), posterior, self.widths)

    def demonstrate(self, query: Array, *, rng: np.random.Generator) -> Demonstration:
        """Show where the task's true weights want the item, as well as the teacher can.

        A wish: something may stand there.
        """
        weights = self.task.true_weights
        placement = self.teacher.show(weights, query, self.widths, rng=rng)
        return Demonstration(query, placement)

    def wishes(self, layouts: Array) -> Array:
        """Return where the person wants the item in layouts, shape (L, 2)."""
        return self.teacher.wishes(self.task.true_weights, layouts, self.widths)

    def free_wish(self, layout: Array) -> Array | None:
        """Return where the person would put the item, as it has to fit, shape (2,).

        None for someone whose wish is not the greatest reward: what is second best to
        them is not known.
        """
        if not self.teacher.wants_best:
            return None
        return self.best_free_placement(self.task.true_weights, layout)

    def best_placements(self, weights: Array, layouts: Array) -> Array:
        """Find the best placement of each reward in each layout, free or not.

        Args:
            weights: Reward weights, shape (N, K + 9).
            layouts: Layouts, shape (L, K, 2), in table units.

        Returns:
            Placements, shape (L, N, 2), in table units.
        """
        return best_placements(weights, layouts, self.widths)

    def reward_map(self, weights: Array, layout: Array, size: int) -> Array:
        """Evaluate a reward on a lattice that spans the unit square.

        Args:
            weights: Reward weights, shape (K + 9,).
            layout: Object centers, shape (K, 2), in table units.
            size: Points along each side, n.

        Returns:
            Rewards, shape (n, n); rows from y = 0 up, columns from x = 0.
        """
        ticks = np.linspace(0.0, 1.0, size)
        points = np.stack(np.meshgrid(ticks, ticks), axis=-1)
        return rbf_features(points, all_centers(layout), self.widths) @ weights

    def best_free_placement(self, weights: Array, layout: Array) -> Array:
        """Find the best placement where the item fits: on the table or in a receptacle.

        Args:
            weights: Reward weights, shape (K + 9,).
            layout: Object centers, shape (K, 2), in table units.

        Returns:
            The placement, shape (2,), in table units.
        """
        spaces = [self.space.free_space(layout, self.task.receptacles)]
        found = best_placements(weights[None], layout[None], self.widths, spaces)
        return found[0, 0]


def load_kernels() -> None:
    """Load the machine code behind inference and placements, or compile it.

    The first use of an installation compiles, for some seconds; to call this first keeps
    that out of what is timed, and out of processes that would all do the same.
    """
    mcmc = replace(
        PAPER.mcmc, num_steps=8, num_samples=4, num_particles=4, num_chains=4
    )
    rng = np.random.default_rng(0)
    for name in MODELS:
        config = replace(
            DEFAULT, likelihood=name, mcmc=replace(mcmc, starts_at_map=False)
        )
        problem = PlacementProblem(VASE, config)
        demo = problem.demonstrate(np.full((len(VASE.objects), 2), 0.5), rng=rng)
        posterior = problem.infer([demo], None, rng=rng)
        problem.policy_losses([demo.layout], posterior)
    climb(np.zeros((1, 2)), np.eye(1), np.zeros((1, 1, 2)), np.ones(1))
