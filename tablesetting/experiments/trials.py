"""The trials of a study, and where each one's randomness comes from."""

from dataclasses import dataclass

import numpy as np

from tablesetting.experiments.config import TaskName
from tablesetting.experiments.study_config import TrialsConfig
from tablesetting.reward.tasks import TASKS


@dataclass(frozen=True)
class Trial:
    """A repetition of one task.

    Attributes:
        task: The task.
        index: Which repetition, from 0.
    """

    task: TaskName
    index: int

    def seeds(self, seed: int) -> np.random.SeedSequence:
        """Return the source of its randomness, whatever else the study does."""
        return np.random.SeedSequence(
            seed, spawn_key=(list(TASKS).index(self.task), self.index)
        )


def all_trials(config: TrialsConfig) -> list[Trial]:
    """List the trials of a study, those of other shards as well, task by task."""
    return [
        Trial(task, index)
        for task in config.tasks
        for index in range(config.num_trials)
    ]


def shard_trials(config: TrialsConfig) -> list[Trial]:
    """List the trials of the study's own shard."""
    index, num_shards = config.shard_of
    return all_trials(config)[index::num_shards]
