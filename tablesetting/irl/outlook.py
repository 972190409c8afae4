"""What a posterior says of the queries that could be asked, for strategies to score."""

from dataclasses import dataclass
from typing import Protocol

from tablesetting.irl.arrays import Array, Indices


@dataclass(frozen=True)
class Answers:
    r"""Answers that a query could get.

    Attributes:
        likelihoods: Probability of each answer under each sample,
            :math:`P(a_g \mid w_m)`, shape (M, G).
        probabilities: Chance of each answer by the whole posterior, shape (G,), of sum
            1: the mean of the likelihoods where the answers are all that there are;
            1 / G where they were drawn.
    """

    likelihoods: Array
    probabilities: Array


class Outlook(Protocol):
    """What the samples of a posterior say of Q candidate queries.

    Everything is worked out when it is first asked for. Strategies that compare samples
    with each other see M of them, evenly spread over all N, each equally probable.
    """

    @property
    def num_queries(self) -> int:
        """Number of candidates, Q."""
        ...

    @property
    def ess(self) -> float:
        """Independent draws that the N samples are worth."""
        ...

    @property
    def losses(self) -> Array:
        """Loss of the robot's guess under each sample, shape (Q, N)."""
        ...

    def answers(self, query: int) -> Answers:
        """Return the answers that a query could get."""
        ...

    def classes(self, query: int) -> Indices:
        """Return the class that each sample's best decision falls in, shape (M,)."""
        ...

    def distances(self, query: int) -> Array:
        """Return the losses between the samples' best decisions, shape (M, M)."""
        ...

    def values(self, query: int) -> Array:
        """Return what sample i makes of the best decision of sample j, shape (M, M)."""
        ...

    def best_mean_value(self, query: int) -> float:
        """Return the highest reward of one decision, on average over the M samples."""
        ...

    @property
    def deployed_losses(self) -> Array:
        """Loss of the guess in T situations of the deployment, shape (T, M)."""
        ...

    @property
    def deployed_distances(self) -> Array:
        """Losses between the samples' decisions there, on average, shape (M, M)."""
        ...
