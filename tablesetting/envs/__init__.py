"""Gymnasium environments; importing this package registers them.

`tablesetting/PlaceVase-v0` and `PlaceSpoon-v0` are a placement long, the arm doing the
rest; `tablesetting/VaseJoints-v0` and `SpoonJoints-v0` move its joints.
"""

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "the environments need Gymnasium; install it by "
        "`pip install 'tablesetting[gym]'`",
        name=error.name,
    ) from error

from tablesetting.reward.tasks import TASKS


def register() -> None:
    """Enter the environments of all tasks, unless they are, in Gymnasium's registry."""
    for name in TASKS:
        _register(f"Place{name.title()}", "placement_env:PlacementEnv", name)
        _register(f"{name.title()}Joints", "joint_env:JointEnv", name)


def _register(name: str, env: str, task: str) -> None:
    full_id = f"tablesetting/{name}-v0"
    if full_id not in gymnasium.registry:
        entry_point = f"tablesetting.envs.{env}"
        gymnasium.register(full_id, entry_point=entry_point, kwargs={"task": task})


register()
