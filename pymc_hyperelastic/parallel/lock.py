"""A lock that lets one thread of a process at a time run functions of this package."""

import threading
from collections.abc import Callable
from functools import cache, wraps

from threadpoolctl import ThreadpoolController

#: PyTensor changes its settings for all threads of a process, and compiled functions keep their
#: input between two steps: two threads would mix their numbers.
LOCK = threading.RLock()


def one_thread[**P, R](function: Callable[P, R]) -> Callable[P, R]:
    """Let a function wait until no other thread is in such a function, and use one thread itself.

    Linear algebra in several threads rounds sums in another order, so that results would depend on
    the number of cores. The matrices of this package are too small for threads to save time.

    Examples
    --------
    >>> @one_thread
    ... def double(x):
    ...     return 2 * x
    >>> double(3)
    6
    """

    @wraps(function)
    def alone(*args: P.args, **kwargs: P.kwargs) -> R:
        with LOCK, _thread_pools().limit(limits=1):
            return function(*args, **kwargs)

    return alone


@cache
def _thread_pools() -> ThreadpoolController:
    """Find the libraries with threads of their own, once: this takes milliseconds."""
    return ThreadpoolController()
