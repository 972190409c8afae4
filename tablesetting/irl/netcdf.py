"""Samples as a file that ArviZ reads."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tablesetting import __version__
from tablesetting.errors import OutputError
from tablesetting.irl.arrays import Array

Attribute = str | int | float

_DIMENSIONS = ("chain", "draw", "weight")


def save_netcdf(
    path: Path,
    posterior: Mapping[str, Array],
    sample_stats: Mapping[str, Array],
    attributes: Mapping[str, Attribute] | None = None,
) -> None:
    """Write chains as NetCDF in the InferenceData schema; `arviz.from_netcdf` reads it.

    The groups are "posterior" and "sample_stats", their variables over the dimensions
    chain, draw and, for "weights", weight. Needs the extra `tablesetting[arviz]`.

    Args:
        path: The file, replaced if there is one.
        posterior: Parameters by name, such as "weights", shape (C, S, D); others of
            shape (C, S).
        sample_stats: What is known of each state, shape (C, S) each, such as "lp", its
            log posterior.
        attributes: What else to say of the samples; joins who wrote them.

    Raises:
        OutputError: If the extra is not installed.
        OSError: If the file cannot be written.
    """
    require_netcdf(path)
    import h5netcdf  # Most users never need it.

    groups = {"posterior": posterior, "sample_stats": sample_stats}
    about = _library() | dict(attributes or {})
    with h5netcdf.File(path, "w") as file:
        file.attrs.update(about)
        for name, variables in groups.items():
            group = file.create_group(name)
            group.attrs.update(about)
            _fill(group, variables)


def require_netcdf(path: Path) -> None:
    """Refuse to go on towards a file that cannot be written.

    Raises:
        OutputError: If the extra is not installed.
    """
    try:
        import h5netcdf  # noqa: F401
        import h5py  # noqa: F401, as h5netcdf is there without it, too.
    except ImportError as error:
        raise OutputError(
            f"cannot write '{path}' without {error.name or 'h5netcdf'}; "
            "run: pip install 'tablesetting[arviz]'"
        ) from error


def _library() -> dict[str, Attribute]:
    """Name this package as the schema asks for it."""
    kinds = ("creation", "inference")
    names: dict[str, Attribute] = {f"{kind}_library": "tablesetting" for kind in kinds}
    return names | {f"{kind}_library_version": __version__ for kind in kinds}


def _fill(group: Any, variables: Mapping[str, Array]) -> None:
    """Write variables, shape (C, S, ...) each, and number what their axes hold."""
    shape = max((values.shape for values in variables.values()), key=len, default=())
    for dimension, size in zip(_DIMENSIONS, shape, strict=False):
        group.dimensions[dimension] = size
        group.create_variable(dimension, (dimension,), data=np.arange(size))
    for name, values in variables.items():
        group.create_variable(name, _DIMENSIONS[: values.ndim], data=values)
