"""The work on one batch, in any process."""

import warnings
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, Protocol

from pymc_hyperelastic.parallel.lock import one_thread


class Part(Protocol):
    """The file into which the result of a batch is written."""

    @property
    def path(self) -> Path:
        """Its absolute path, which all workers can reach."""

    def save(self, result: Any) -> None:
        """Write the file completely, or not at all."""


class Work(ABC):
    """Settings of the work on each batch. They are sent to the workers."""

    @abstractmethod
    def prepare(self) -> Any:
        """Return what :meth:`do` needs for every batch. It is called once in each process."""

    @abstractmethod
    def do(self, prepared: Any, data: Any, part: Part) -> Any:
        """Compute a batch, write its part, and return a short answer to the calling process."""


# The prepared work of this process, by its token: one at a time.
_prepared: dict[str, Any] = {}


@one_thread
def run_batch(work: Work, token: str, data: Any, part: Part) -> Any:
    """Do the work of a batch and write its part.

    Parameters
    ----------
    work : Work
        What is done.
    token : str
        Name of the work: a process that has prepared work of this name does not prepare it again.
    data
        Data of the batch.
    part : Part
        File of the result.

    Returns
    -------
    object
        The answer of the work.
    """
    # The results hold all that a warning would say.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if token not in _prepared:
            _prepared.clear()
            _prepared[token] = work.prepare()
        return work.do(_prepared[token], data, part)
