"""Classify a cohort."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import xarray as xr

from pymc_hyperelastic.classes.classification import Classification
from pymc_hyperelastic.cohorts.representatives import representatives
from pymc_hyperelastic.cohorts.run import run_cohort
from pymc_hyperelastic.cohorts.work import Prepared, Work
from pymc_hyperelastic.evidence.keeping import seed_kept
from pymc_hyperelastic.io.checksum import digests_of
from pymc_hyperelastic.models.settings import wall_of
from pymc_hyperelastic.parallel import LOCK


@dataclass(frozen=True)
class Classifying(Work):
    """Classes, and how they are held against new data."""

    name: ClassVar[str] = "classify_cohort"

    by: str
    classes: xr.DataTree
    like: xr.Dataset
    settings: dict[str, Any]
    materials: list[Any] = field(default_factory=list)
    """Strain energies of the classes: a worker learns of a user's own law by receiving it."""

    def manifest(self) -> dict[str, Any]:
        """The classes by their numbers, and settings."""
        settings = dict(self.settings)
        trees = [self.classes, *settings.pop("average_over")]
        return {
            "classes": [digests_of(tree.children) for tree in trees],
            **settings,
        }

    def prepare(self) -> Prepared:
        """Set up the classification."""
        return self.classification().of

    def classification(self) -> Classification:
        """The classification, set up for data like those of the cohort."""
        return Classification(self.classes, self.like, by=self.by, **self.settings)


def classify_cohort(
    data: xr.Dataset,
    classes: xr.DataTree,
    store: str | Path,
    *,
    by: Literal["test", "specimen"] = "specimen",
    class_prior: Mapping[str, float] | None = None,
    average_over: Sequence[xr.DataTree] = (),
    undecided_below: float = 0.0,
    none_below: float = 0.0,
    client: Any = None,
    cores: int | None = None,
    batch_size: int = 64,
    random_seed: Any = None,
    progressbar: bool = True,
) -> None:
    """Classify many specimens, or experiments, in batches, and keep finished batches in a folder.

    The result of a specimen does not depend on the other specimens, the computer or the order.

    Parameters
    ----------
    data : xarray.Dataset
        Inflation data of the cohort.
    classes : xarray.DataTree
        Result of :func:`~pymc_hyperelastic.fit_classes`.
    store, client, cores, batch_size, random_seed, progressbar
        See :func:`fit_cohort`.
    by, class_prior, average_over, undecided_below, none_below
        See :func:`~pymc_hyperelastic.classify`.

    See Also
    --------
    open_cohort : The result, that of :func:`~pymc_hyperelastic.classify`.

    Raises
    ------
    TypeError, ValueError
        If data, classes or settings are unsound, before anything is computed; if the store holds
        other work.
    OSError
        If the store cannot be written, or no worker is left. Finished batches are kept.

    Warns
    -----
    UserWarning
        If a part of the store is damaged: it is computed again.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> classes = ph.open_result("pooled.nc")  # saved from the example of fit_classes
    >>> settings = {"random_seed": 1, "progressbar": False}
    >>> new = ph.select(data, experiment=3)
    >>> ph.classify_cohort(new, classes, "classified", cores=1, **settings)
    >>> ph.open_cohort("classified")["decision"].sel(specimen="S4").item()
    'C2'
    """
    settings = {
        "class_prior": class_prior,
        "average_over": [*average_over],
        "undecided_below": undecided_below,
        "none_below": none_below,
        "random_seed": seed_kept(random_seed, store).entropy,
    }
    trees = [classes, *average_over]
    materials = [
        layer.energy
        for tree in trees
        for child in tree.children.values()
        for layer in wall_of(child)
    ]
    work = Classifying(by, classes, representatives(data), settings, materials)
    with LOCK:  # not around the batches: workers may be threads of this process
        work.classification().check_new(data)
    running = {"client": client, "cores": cores, "batch_size": batch_size}
    run_cohort(work, data, store, **running, progressbar=progressbar)
