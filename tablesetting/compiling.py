"""Machine code by numba, kept beside the source where that can be."""

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])


def compiled(*fastmath: str, **options: Any) -> Callable[[FunctionT], FunctionT]:
    """Let numba compile a function, and keep the machine code where that can be.

    Args:
        fastmath: What the compiler may take for granted of floats, as LLVM names it.
        options: Further ones of `numba.njit`.
    """

    def compile_function(function: FunctionT) -> Any:
        try:
            return njit(cache=True, fastmath=set(fastmath), **options)(function)
        except RuntimeError:  # Neither its folder nor the user's own can be written.
            return njit(fastmath=set(fastmath), **options)(function)

    return compile_function
