"""Run batches in this process, in local processes or on Dask; and a lock for threads."""

from pymc_hyperelastic.parallel.lock import LOCK, one_thread

__all__ = ["LOCK", "one_thread"]
