"""Classify new experiments or specimens by their marginal likelihood under fitted classes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Literal

import xarray as xr
from pymc.progress_bar import create_simple_progress

from pymc_hyperelastic.classes.classification import Classification, in_doubt
from pymc_hyperelastic.data.inflation import check_data, describe_test
from pymc_hyperelastic.data.representatives import representatives
from pymc_hyperelastic.data.select import units_of
from pymc_hyperelastic.evidence.keeping import seed_kept
from pymc_hyperelastic.io.batches import Prepared, Remarks, UnitWork, run_in_batches
from pymc_hyperelastic.io.open import open_result
from pymc_hyperelastic.io.store import Store
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.settings import wall_of
from pymc_hyperelastic.parallel import LOCK


@dataclass(frozen=True)
class Classifying(UnitWork):
    """Classes and settings of a classification, as they are sent to the workers of a store."""

    name: ClassVar[str] = "classify"

    by: str
    classes: xr.DataTree
    like: xr.Dataset
    settings: dict[str, Any]
    materials: list[Any]
    """Strain energies of the classes: a worker learns of a user's own law by receiving it."""

    def prepare(self) -> Prepared:
        """Set up the classification."""
        return Classification(self.classes, self.like, by=self.by, **self.settings).of

    def doubts(self, result: xr.Dataset) -> list[str]:
        """Return a text for each row whose evidences are unreliable."""
        return ["unreliable evidence" if doubt else "" for doubt in in_doubt(result)]


def classify(
    new_data: xr.Dataset,
    classes: xr.DataTree,
    *,
    by: Literal["test", "specimen"] = "test",
    class_prior: Mapping[str, float] | None = None,
    average_over: Sequence[xr.DataTree] = (),
    undecided_below: float = 0.0,
    none_below: float = 0.0,
    store: str | Path | Store | None = None,
    random_seed: Any = None,
    progressbar: bool = True,
) -> xr.Dataset:
    r"""Compute the posterior probability of each class for new experiments or specimens.

    .. math:: P(C | D) = \frac{P(D | C) P(C)}{\sum_{C'} P(D | C') P(C')}, \qquad
        P(D | C) = \int P(D | θ) P(θ | C) \, dθ

    ``P(θ | C)`` is the posterior of class ``C``, which is not fitted again. The integral is
    computed by the fastest reliable one of several methods, see the variable ``method``.

    Parameters
    ----------
    new_data : xarray.Dataset
        New inflation data. Measurements of the training data are refused, also under other names:
        a class would be too probable for them. With variability, a specimen of the new data is
        assumed not to be in the training data; further experiments on a specimen of the training
        data cause a warning. Without variability, new curves are those of the class's one material.
    classes : xarray.DataTree
        Result of :func:`fit_classes`, or one read from a file.
    by : {"test", "specimen"}
        "test" classifies each experiment by itself, "specimen" all experiments on a specimen
        jointly.
    class_prior : dict of str to float, optional
        Prior probability of each class; by default all are equal. It is required if a class of the
        result could not be fitted, to confirm that only the other classes are possible.
    average_over : sequence of xarray.DataTree, optional
        Results for the same classes and training data with other strain energies. The predictions
        are averaged with the posterior probabilities of the strain energies, which are proportional
        to the product of the evidences of their classes. They are returned as
        ``strain_energy_probability``, the log evidences as ``strain_energy_log_evidence``, and the
        probabilities given the training data of one class alone as
        ``strain_energy_class_probability`` (strain_energy, class_label), each with a standard error
        (``_se``); see :func:`~pymc_hyperelastic.plot_law_probability`. All standard errors of the
        result include those of the evidences: if one is infinite, every decision is "cannot be
        judged". p-values are averaged with the same probabilities. Evidences are comparable only
        between classes with the same noise, or between classes that all have variability; such
        classes may be given both with and without an experiment effect for the same strain energy.
    undecided_below : float, default 0
        If the probability of the most probable class is below this value, the decision is
        "undecided".
    none_below : float, default 0
        If the p-values of all classes are below this value, the decision is "none of these". With
        0.05, up to one in twenty specimens that belong to a class is decided so. Only for classes
        with variability.
    store : Store, str or Path, optional
        Folder for finished batches, and who computes them, see :class:`Store`: for many specimens,
        several processes or a cluster. After an interrupt or a kill, the same call continues. The
        numbers of an experiment or specimen are the same as without a store.
    random_seed : int, optional
        Seed of the random numbers; the same seed gives the same result. Without one it is chosen,
        and kept in the store.
    progressbar : bool
        Whether to show progress. After an interrupt, results that are not yet computed are NaN;
        with a store, the interrupt is raised.

    Returns
    -------
    xarray.Dataset
        The first dimension, ``row`` below, is ``test`` or ``specimen``, in the order of the data.

        ``decision`` : the most probable class, "undecided", "none of these", or "cannot be judged"
        if an evidence that could change the decision is unreliable, or if `none_below` is used and
        there is no p-value.

        ``class_probability``, ``log_evidence`` : (row, class_label), each with its standard error
        (``_se``). Log evidences are in nats.

        ``method`` : method of the integral, (row, class_label). Without variability it is "class
        draws", the mean likelihood of the class's draws; "adapted draws", importance sampling from
        a normal mixture fitted to the posterior with the new data; or, if the Pareto shape of the
        weights is at least 0.5 or the effective sample size is too small for both of these,
        "tempering", SMC from the class's draws. With variability, the parameters of a specimen are
        a new draw from the class's distribution; the integral uses importance-sampling draws of the
        specimen ("specimen draws") or SMC draws ("specimen draws by tempering").

        ``pareto_k`` : Pareto shape of the importance weights, (row, class_label). With variability
        it is the larger shape of two sets of weights: those of the specimen's draws, and those of
        the same draws under the class. At 0.5 or above the evidence is not reliable.

        ``p_value`` : with variability, the probability that a specimen of the class is as extreme
        as the new one, (row, class_label), from two p-values. ``typical_p_value`` compares the
        specimen's material, and the differences between its tests if the class has an experiment
        effect, with the distribution of the class in logarithmic coordinates. ``fit_p_value`` tests
        whether this strain energy fits the curves as well as those of the class's specimens: by an
        F test of the misfits if the noise is known, and otherwise as the fraction of specimens of
        the class whose noise is at least as large. All are NaN if the curves do not inform about
        the material.

        ``class_verdict`` : reliability of the fit of each class, (class_label), see
        :func:`~pymc_hyperelastic.diagnose_evidence`.

        ``error`` : message of the error for rows whose computation failed; empty for others.

        With a store the result is read from it when it is needed, see :func:`open_result`. If a
        process dies several times while it computes a row, `error` says so, all numbers of the row
        are NaN, its decision is empty, and the next call computes the row again.

    Warns
    -----
    UserWarning
        If new data and training data of classes with variability contain different experiments on
        the same specimen; if a row cannot be judged; if an interrupt leaves rows uncomputed; or if
        a part of the store is damaged, which is computed again.

    Raises
    ------
    TypeError, ValueError
        If the data are invalid or contain training data, `classes` are not fitted classes of one
        model, a class could not be fitted and `class_prior` is missing, `class_prior` does not
        hold a probability of each class, or the store holds other work.
    OSError
        If the store cannot be written, or no worker is left. Finished batches are kept.

    See Also
    --------
    fit_classes, explain_classification, plot_class_probability, Store, fit_cohort

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> classes = ph.open_result("pooled.nc")  # saved from the example of fit_classes
    >>> new = ph.select(data, specimen="S4", experiment=3)
    >>> result = ph.classify(new, classes, random_seed=2, progressbar=False)
    >>> result["class_probability"].idxmax("class_label").item()
    'C2'
    """
    check_data(new_data)
    like = representatives(new_data)
    settings: dict[str, Any] = {
        "class_prior": class_prior,
        "average_over": average_over,
        "undecided_below": undecided_below,
        "none_below": none_below,
        "random_seed": seed_kept(random_seed, store).entropy,
    }
    with LOCK:
        classification = Classification(classes, like, by=by, **settings)
        classification.check_new(new_data)
    layers = [wall_of(child) for tree in classification.trees for child in tree.children.values()]
    materials = [layer.energy for wall in layers for layer in wall]
    work, units = Classifying(by, classes, like, settings, materials), units_of(new_data, by)
    if store is None:
        with LOCK, (progress := create_simple_progress(progressbar)):
            bar = progress.add_task("Classifying", completed=0, total=len(units))
            advance = partial(progress.advance, bar)
            result = classification.of(new_data, advance, interruptible=True)
        remarks = work.remarks(result, [*units])
    else:
        # Without the lock: workers may be threads of this process.
        manifest = classification.manifest()
        remarks = run_in_batches(work, manifest, new_data, store, progressbar=progressbar)
        opened = open_result(store)
        assert isinstance(opened, xr.Dataset)
        result = opened
    _warn(remarks, new_data, units)
    return result


def _warn(remarks: Remarks, data: xr.Dataset, units: Mapping[str, Sequence[int]]) -> None:
    """Warn if the computation of rows failed, or evidences are unreliable."""
    if remarks.failed:
        label, error = next(iter(remarks.failed.items()))
        name, others = describe_test(data, units[label][0]), len(remarks.failed) - 1
        also = f"; nor can {others} of the others: see 'error' of the result" if others else ""
        warn_user(f"{name} cannot be judged: {error}{also}")
    if remarks.doubtful:
        warn_user(
            f"{len(remarks.doubtful)} of {len(units)} cannot be judged: see class_verdict, "
            "log_evidence_se, pareto_k and p_value"
        )
