"""Executed episodes as a LeRobot v3 dataset.

Source: the dataset format v3.0 of https://github.com/huggingface/lerobot.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tablesetting.experiments.episodes import (
    FRAME_RATE,
    Episode,
    list_episodes,
    read_episode,
)
from tablesetting.experiments.replay import read_run
from tablesetting.irl.arrays import Array
from tablesetting.reward.tasks import TASKS, PlacementTask
from tablesetting.scene.scene import Scene

_FILE = "chunk-000/file-000.parquet"
_JOINTS = tuple(f"joint_{number}" for number in range(1, 7))
_INDICES = ("frame_index", "episode_index", "index", "task_index")


def write_dataset(run: Path, out: Path) -> None:
    """Write all executed episodes of a run.

    A row is a snapshot. `observation.state` are the six joints, in [rad], and the opening
    of the jaw, in [m]; `action` is what the servos were told: positions or, with
    `--servos real`, velocities of the joints, and the opening. `observation.environment_state`
    is where every object and the item are, x, y, z each, in [m].

    Args:
        run: Folder of the run.
        out: Folder that the dataset is written into.

    Raises:
        InvalidFile: If the folder is of no run, or the arm did not act.
    """
    config, _ = read_run(run)
    task = TASKS[config.task]
    scene = Scene(task.objects, task.item)
    episodes = [read_episode(run, number) for number in list_episodes(run)]
    frames = [_frames(episode, scene) for episode in episodes]
    lengths = [len(each["action"]) for each in frames]
    columns = {
        name: np.concatenate([each[name] for each in frames]) for name in frames[0]
    }
    total = sum(lengths)
    columns |= {
        "timestamp": np.concatenate([np.arange(n) / FRAME_RATE for n in lengths]),
        "frame_index": np.concatenate([np.arange(n) for n in lengths]),
        "episode_index": np.repeat(np.arange(len(lengths)), lengths),
        "index": np.arange(total),
        "task_index": np.zeros(total, dtype=np.int64),
    }
    _write(out / "data" / _FILE, {name: _column(a) for name, a in columns.items()})
    words = f"Place the {task.item}."
    _write_tasks(out / "meta" / "tasks.parquet", words)
    _write(out / "meta" / "episodes" / _FILE, _episode_columns(lengths, words))
    _write_json(out / "meta" / "stats.json", {k: _stats(v) for k, v in columns.items()})
    _write_json(out / "meta" / "info.json", _info(task, lengths))


def _frames(episode: Episode, scene: Scene) -> dict[str, Array]:
    episode.check_scene(scene)
    robot = scene.robot
    places = [episode.qpos[:, scene.pose_slice(n)][:, :3] for n in scene.body_ids]
    jaw = episode.qpos[:, robot.jaw_qpos].mean(axis=1, keepdims=True)
    return {
        "observation.state": np.hstack([episode.qpos[:, robot.arm_qpos], jaw]),
        "observation.environment_state": np.hstack(places),
        "action": episode.ctrl[:, [*robot.arm_ctrl, robot.jaw_ctrl]],
    }


def _info(task: PlacementTask, lengths: list[int]) -> dict[str, Any]:
    props = [f"{name}_{a}" for name in (*task.objects, task.item) for a in "xyz"]
    joints = [*_JOINTS, "jaw_opening"]
    features: dict[str, Any] = {
        "observation.state": _feature("float32", joints),
        "observation.environment_state": _feature("float32", props),
        "action": _feature("float32", joints),
        "timestamp": _feature("float32", None),
        **{name: _feature("int64", None) for name in _INDICES},
    }
    return {
        "codebase_version": "v3.0",
        "robot_type": "jaco",
        "total_episodes": len(lengths),
        "total_frames": sum(lengths),
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": int(FRAME_RATE),
        "splits": {"train": f"0:{len(lengths)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }


def _feature(dtype: str, names: list[str] | None) -> dict[str, Any]:
    return {"dtype": dtype, "shape": [len(names) if names else 1], "names": names}


def _episode_columns(lengths: list[int], words: str) -> dict[str, pa.Array]:
    ends = np.cumsum(lengths)
    zeros = np.zeros(len(lengths), dtype=np.int64)
    return {
        "episode_index": pa.array(np.arange(len(lengths))),
        "tasks": pa.array([[words]] * len(lengths)),
        "length": pa.array(lengths),
        "data/chunk_index": pa.array(zeros),
        "data/file_index": pa.array(zeros),
        "dataset_from_index": pa.array(ends - lengths),
        "dataset_to_index": pa.array(ends),
        "meta/episodes/chunk_index": pa.array(zeros),
        "meta/episodes/file_index": pa.array(zeros),
    }


def _column(values: Array) -> pa.Array:
    """Return a column of numbers, or of vectors of one length."""
    if np.issubdtype(values.dtype, np.integer):
        return pa.array(values.astype(np.int64))
    flat = pa.array(values.astype(np.float32).ravel())
    if values.ndim == 1:
        return flat
    return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _stats(values: Array) -> dict[str, list[float]]:
    rows = values.reshape(len(values), -1).astype(float)
    return {
        "min": rows.min(axis=0).tolist(),
        "max": rows.max(axis=0).tolist(),
        "mean": rows.mean(axis=0).tolist(),
        "std": rows.std(axis=0).tolist(),
        "count": [len(rows)],
    }


def _write_tasks(path: Path, words: str) -> None:
    """Write the table of tasks; pandas is to take the words for its index."""
    table = pa.table({"task_index": pa.array([0]), "task": pa.array([words])})
    kinds = (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    described = [
        {
            "name": name,
            "field_name": name,
            "pandas_type": pandas_type,
            "numpy_type": numpy_type,
            "metadata": None,
        }
        for name, pandas_type, numpy_type in kinds
    ]
    pandas = {"index_columns": ["task"], "column_indexes": [], "columns": described}
    path.parent.mkdir(parents=True, exist_ok=True)
    schema = {"pandas": json.dumps(pandas | {"pandas_version": "2.0.0"})}
    pq.write_table(table.replace_schema_metadata(schema), path)


def _write(path: Path, columns: Mapping[str, pa.Array]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(dict(columns)), path)


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
