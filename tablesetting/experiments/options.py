"""The options of a command, as config.json keeps them."""

import json
import types
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

ConfigT = TypeVar("ConfigT")

_MAX_NUMBER = 1e300  # A larger whole number could not even become a float.


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
