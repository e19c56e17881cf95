"""How often anything is tried: the same cases each time, or many times as many that are new."""

import os

from hypothesis import HealthCheck, settings

TIMES = int(os.environ.get("FUZZ", "1"))


def cases(count: int) -> settings:
    """So many cases, and ``FUZZ`` times as many."""
    return settings(
        max_examples=count * TIMES,
        deadline=None,
        database=None,
        derandomize=TIMES == 1,
        suppress_health_check=list(HealthCheck),
    )
