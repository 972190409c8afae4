"""Worlds and demonstrations as JSON."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gridworld_bench.likelihood import Evidence
from gridworld_bench.mdp import Mdp
from tablesetting.errors import InvalidFile
from tablesetting.irl.arrays import Array
from tablesetting.results import RunFolder, read_json

WORLD_FORMAT = "gridworld-world/1"
DEMONSTRATIONS_FORMAT = "gridworld-demonstrations/1"


def save_world(path: Path, mdp: Mdp, true_weights: Array | None = None) -> None:
    """Write a world, and what is wanted there if that is known.

    Args:
        path: The file.
        mdp: The world.
        true_weights: Reward weights, shape (D,).

    Raises:
        OutputError: If it cannot be written; no half of it remains.
    """
    content = {
        "format": WORLD_FORMAT,
        "successors": mdp.successors.tolist(),
        "probabilities": mdp.probabilities.tolist(),
        "features": mdp.features.tolist(),
        "discount": mdp.discount,
        "initial_states": mdp.initial_states.tolist(),
        "terminal_states": np.flatnonzero(mdp.is_terminal).tolist(),
        "true_weights": None if true_weights is None else true_weights.tolist(),
    }
    RunFolder(path.parent).write_json(path.name, content)


def read_world(path: Path) -> tuple[Mdp, Array | None]:
    """Read a world, and what is wanted there if the file says so.

    Raises:
        InvalidFile: If it cannot be read, or is no MDP.
    """
    content = read_json(path, WORLD_FORMAT)
    features = _read(content, path, "features", np.float64, 2)
    terminal_states = _read(content, path, "terminal_states", np.intp, 1)
    is_terminal = np.zeros(len(features), dtype=bool)
    try:
        discount = content.get("discount")
        if not isinstance(discount, int | float) or isinstance(discount, bool):
            raise ValueError(f"`discount` must be a number; got {discount!r:.60}")
        if ((terminal_states < 0) | (terminal_states >= len(features))).any():
            raise ValueError(f"`terminal_states` must be states, below {len(features)}")
        is_terminal[terminal_states] = True
        mdp = Mdp(
            successors=_read(content, path, "successors", np.intp, 3),
            probabilities=_read(content, path, "probabilities", np.float64, 3),
            features=features,
            discount=float(discount),
            initial_states=_read(content, path, "initial_states", np.intp, 1),
            is_terminal=is_terminal,
        )
    except (ValueError, OverflowError) as error:
        raise InvalidFile(f"'{path}': {error}; mend it") from error
    if content.get("true_weights") is None:
        return mdp, None
    weights = _read(content, path, "true_weights", np.float64, 1)
    if weights.shape != (mdp.num_features,) or not np.isfinite(weights).all():
        raise InvalidFile(
            f"'{path}': `true_weights` must be {mdp.num_features} finite numbers"
        )
    return mdp, weights


def save_demonstrations(path: Path, evidence: Evidence) -> None:
    """Write state-action pairs, and whether each is good.

    Raises:
        OutputError: If it cannot be written; no half of it remains.
    """
    rows = zip(evidence.states, evidence.actions, evidence.is_good, strict=True)
    pairs = [
        {"state": int(state), "action": int(action), "is_good": bool(is_good)}
        for state, action, is_good in rows
    ]
    content = {"format": DEMONSTRATIONS_FORMAT, "pairs": pairs}
    RunFolder(path.parent).write_json(path.name, content)


def read_demonstrations(path: Path, mdp: Mdp) -> Evidence:
    """Read state-action pairs of a world.

    Raises:
        InvalidFile: If it cannot be read, has no pair, or one that the world has not.
    """
    pairs = read_json(path, DEMONSTRATIONS_FORMAT).get("pairs")
    if not isinstance(pairs, list) or not pairs:
        raise InvalidFile(f"'{path}': `pairs` must be a list of at least one")
    limits = {"state": mdp.num_states, "action": mdp.num_actions}
    for number, pair in enumerate(pairs):
        is_pair = isinstance(pair, Mapping) and set(pair) == {*limits, "is_good"}
        if not is_pair or type(pair["is_good"]) is not bool:
            raise InvalidFile(
                f"'{path}': pair {number} must have a `state`, an `action` and `is_good`; "
                f"got {pair!r:.60}"
            )
        for name, limit in limits.items():
            if type(pair[name]) is not int or not 0 <= pair[name] < limit:
                raise InvalidFile(
                    f"'{path}': pair {number} has the {name} {pair[name]!r:.60}; give one "
                    f"in [0, {limit})"
                )
    column: Callable[[str], list[Any]] = lambda name: [pair[name] for pair in pairs]  # noqa: E731
    return Evidence(
        np.array(column("state")),
        np.array(column("action")),
        np.array(column("is_good")),
    )


def _read(
    content: Mapping[str, Any], path: Path, field: str, kind: type, num_axes: int
) -> Any:
    """Return a field as an array of numbers."""
    try:
        array = np.array(content.get(field))
    except (ValueError, OverflowError):  # Rows of several lengths.
        array = np.array(None)
    is_number = array.dtype.kind in ("iu" if kind is np.intp else "iuf")
    if array.size == 0 and array.ndim == num_axes:
        is_number = True
    if not is_number or array.ndim != num_axes:
        raise InvalidFile(
            f"'{path}': `{field}` must be numbers in {num_axes} levels of lists"
        )
    return array.astype(kind)
