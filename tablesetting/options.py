"""The options of a command: what they may be, and how config.json keeps them."""

import json
import types
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

ConfigT = TypeVar("ConfigT")

_MAX_NUMBER = 1e300  # A larger whole number could not even become a float.


def refuse_below(config: object, **least: int) -> None:
    """Refuse options that are below the least that has a meaning."""
    for name, bound in least.items():
        value = getattr(config, name, None)
        if value is not None and value < bound:
            option = name.replace("_", "-")
            raise ValueError(f"--{option} must be at least {bound}; got {value}")


def refuse_above(config: object, **most: int) -> None:
    """Refuse options that are so large that they must be slips."""
    for name, bound in most.items():
        value = getattr(config, name, None)
        if value is not None and value > bound:
            option = name.replace("_", "-")
            raise ValueError(f"--{option} must be at most {bound}; got {value}")


def changed_options(config: Any, unset: Any) -> list[str]:
    """Name the options in which two configs differ, those of their groups, too."""
    names = list[str]()
    for name in (each.name for each in fields(config)):
        value, other = getattr(config, name), getattr(unset, name)
        if is_dataclass(value):
            names += changed_options(value, other)
        elif value != other:
            names.append(f"--{name.replace('_', '-')}")
    return sorted(names)


def refuse_changed(config: object, names: tuple[str, ...], where: str) -> None:
    """Refuse options that are not what they are unless told, and would do nothing."""
    defaults = {each.name: each.default for each in fields(config)}  # type: ignore[arg-type]
    for name in names:
        if getattr(config, name) != defaults[name]:
            option = name.replace("_", "-")
            raise ValueError(f"--{option} has no effect {where}")


def refuse_bad_resume(config: Any) -> None:
    """Refuse to go on in a folder that is not named, or is to be replaced."""
    if config.resume and (config.out is None or config.overwrite):
        raise ValueError("--resume goes with --out, and not with --overwrite")


def to_options(config: Any, of_one_call: tuple[str, ...]) -> dict[str, Any]:
    """Return options flat, as JSON has them.

    Args:
        config: A config of a command, whose groups of options are configs as well.
        of_one_call: Names of those that belong to one call and are left out.
    """
    options = asdict(config)
    for described in fields(config):
        if is_dataclass(getattr(config, described.name)):
            options |= options.pop(described.name)
    for name in of_one_call:
        options.pop(name, None)
    return dict(json.loads(json.dumps(options, default=str)))


def from_options(kind: type[ConfigT], options: Mapping[str, Any]) -> ConfigT:
    """Build a config from options, which may be anything.

    Args:
        kind: The config.
        options: What `to_options` returned; what was left out is as it is by default.

    Raises:
        ValueError: If an option is missing or not what it must be.
    """
    hints, values = get_type_hints(kind), {}
    for described in fields(kind):  # type: ignore[arg-type]
        name, hint = described.name, hints[described.name]
        if is_dataclass(hint):
            values[name] = from_options(hint, options)  # type: ignore[arg-type]
        elif name in options:
            values[name] = _convert(options[name], hint, name)
        elif described.default is MISSING and described.default_factory is MISSING:
            raise ValueError(f"it lacks {name}")
    return kind(**values)


def _convert(value: Any, hint: Any, name: str) -> Any:
    """Return a value as the type of its option has it."""
    if get_origin(hint) is Literal:
        if value in get_args(hint) and isinstance(value, str):
            return value
    elif get_origin(hint) in (Union, types.UnionType):
        kinds = [kind for kind in get_args(hint) if kind is not type(None)]
        if value is None:
            return None
        return _convert(value, kinds[0], name)
    elif hint is Path and isinstance(value, str):
        return Path(value)
    elif hint is float and type(value) in (int, float) and abs(value) <= _MAX_NUMBER:
        return float(value)
    elif isinstance(hint, type) and type(value) is hint:
        return value
    raise ValueError(f"{name} is {value!r:.60}")
