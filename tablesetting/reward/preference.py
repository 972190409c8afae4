"""What a task's simulated person thinks of a placement."""

from tablesetting.irl.arrays import Array
from tablesetting.reward.rbf import RbfWidths, all_centers, rbf_features
from tablesetting.reward.tasks import PlacementTask


def true_reward(task: PlacementTask, placement: Array, layout: Array) -> float:
    """Evaluate the true weights of a task, with RBFs of the default widths.

    Args:
        task: Whose person is asked.
        placement: Where the item is, shape (2,), in table units.
        layout: Object centers, shape (K, 2), in table units.

    Returns:
        The reward.
    """
    widths = RbfWidths().per_center(len(task.objects))
    features = rbf_features(placement[None], all_centers(layout), widths)[0]
    return float(features @ task.true_weights)
