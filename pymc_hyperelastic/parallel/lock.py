"""A lock that lets one thread of a process at a time run functions of this package."""

import threading
from collections.abc import Callable
from functools import wraps

#: PyTensor changes its settings for all threads of a process, and compiled functions keep their
#: input between two steps: two threads would mix their numbers.
LOCK = threading.RLock()


def one_thread[**P, R](function: Callable[P, R]) -> Callable[P, R]:
    """Let a function wait until no other thread is in such a function.

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
        with LOCK:
            return function(*args, **kwargs)

    return alone
