"""One thread of a process at a time runs functions of this package, and one those of its BLAS."""

import threading
from collections.abc import Callable
from functools import cache, wraps

from threadpoolctl import ThreadpoolController

#: PyTensor changes its settings for all threads of a process, and compiled functions keep their
#: input between two steps: two threads would mix their numbers.
LOCK = threading.RLock()


def one_thread[**P, R](function: Callable[P, R]) -> Callable[P, R]:
    """Let a function wait until no other thread is in such a function, and use one thread itself.

    Several threads of a BLAS round sums in another order than one, so that results would depend on
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
        with LOCK, _blas().limit(limits=1):
            return function(*args, **kwargs)

    return alone


@cache
def _blas() -> ThreadpoolController:
    """Find the libraries that NumPy and SciPy have loaded, once: this takes milliseconds."""
    return ThreadpoolController().select(user_api="blas")
