"""Classify new experiments by their marginal likelihood."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

import xarray as xr
from pymc.progress_bar import create_simple_progress

from pymc_hyperelastic.classes.classification import Classification, warn_of_doubt
from pymc_hyperelastic.data.select import tests_at, units_of
from pymc_hyperelastic.evidence.keeping import seed_kept
from pymc_hyperelastic.io.store import Store
from pymc_hyperelastic.parallel import one_thread

# Of what is the same in all, the first is taken.
_ROWS: dict[str, Any] = {
    "data_vars": "minimal",
    "coords": "minimal",
    "compat": "override",
    "join": "override",
    "combine_attrs": "override",
}


@one_thread
def classify(
    new_data: xr.Dataset,
    classes: xr.DataTree,
    *,
    by: Literal["test", "specimen"] = "test",
    class_prior: Mapping[str, float] | None = None,
    average_over: Sequence[xr.DataTree] = (),
    undecided_below: float = 0.0,
    none_below: float = 0.0,
    random_seed: Any = None,
    progressbar: bool = True,
    store: str | Path | None = None,
) -> xr.Dataset:
    r"""Probability of each class for new experiments.

    .. math:: P(C | D) = \frac{P(D | C) P(C)}{\sum_{C'} P(D | C') P(C')}, \qquad
        P(D | C) = \int P(D | θ) P(θ | C) \, dθ

    ``P(θ | C)`` is the class's posterior: nothing is fitted again. The integral is taken in the
    cheapest of three ways that can be trusted, see the variable ``method``.

    Parameters
    ----------
    new_data : xarray.Dataset
        New inflation data. Measurements from which a class was learned are refused, under whatever
        names: it would always claim them. With variability new specimens are new to the class, and
        other experiments on a specimen of the training data are warned of; without, they are other
        curves of the class's one material.
    classes : xarray.DataTree
        Result of :func:`fit_classes`, perhaps read from a file.
    by : {"test", "specimen"}
        What is classified: each experiment by itself, or all experiments on a specimen together.
    class_prior : dict of str to float, optional
        Probability of each class beforehand; equal when missing. It is needed if a class of the
        result could not be fitted: it says that the others are all that there are to choose from.
    average_over : sequence of xarray.DataTree, optional
        The same classes, of the same training data, fitted with other strain energies: what each
        says counts by its posterior probability, which is the product of the evidences of its
        classes. The variable ``strain_energy_probability`` tells it, and
        ``strain_energy_probability_se`` what the errors of these evidences leave open, which all
        errors of the result hold too: if one is infinite, nothing can be judged.
        ``strain_energy_log_evidence`` is what it rests on, and ``strain_energy_class_probability``
        (strain_energy, class_label) what each class would say alone, both with their ``_se``; see
        :func:`~pymc_hyperelastic.plot_law_probability`. The p-value is the mean of the laws'
        p-values by these probabilities. Evidences compare only between classes of the same noise,
        or between classes that all have variability; of these one law may be there twice, with an
        experiment effect and without.
    undecided_below : float, default 0
        Probability that the most probable class must have for a decision.
    none_below : float, default 0
        Where the p-value of every class is below this, the decision is "none of these"; with 0.05
        that happens to one in twenty specimens of the classes themselves. Only for classes with
        variability.
    random_seed : int, optional
        The same seed gives the same result.
    progressbar : bool
        Whether to show progress. After an interrupt what is not yet known is NaN.
    store : str or Path, optional
        A folder that keeps what is computed, one experiment or specimen after another: the same
        call goes on from there. For many see :func:`~pymc_hyperelastic.classify_cohort`.

    Returns
    -------
    xarray.Dataset
        ``decision``, the most probable class unless one of the limits above says otherwise, and
        ``class_probability``, ``class_probability_se``, ``log_evidence`` and ``log_evidence_se``,
        each (test, class_label) in the order of the data, or (specimen, class_label). ``method``
        says how the integral was taken: "class draws", the mean likelihood of the class's draws,
        or "adapted draws", importance sampling from a mixture about the modes with the new data or
        from one that followed these, both with a Pareto shape ``pareto_k`` of the weights below
        0.5; else "tempering", by SMC from the class's draws. With variability the parameters of a
        specimen are a fresh draw from the class's distribution, integrated by "specimen draws", or,
        where these could not be had by importance sampling, by "specimen draws by tempering";
        ``pareto_k`` is the larger of the shapes of the weights by which they were drawn and of
        those under the class, and from 0.5 on the evidence is not to be trusted. ``p_value`` is
        then the chance that a specimen of the class itself looks as strange, by either of two signs
        that are given beside it.
        ``typical_p_value`` compares its wall with those that the class would bring forth, in
        coordinates in which half as stiff is as far as twice as stiff. ``fit_p_value`` asks whether
        any wall of this law follows its curves to within the noise: with known noise the chance of
        a worse misfit, else that of noise as large in the class. P-values are NaN if the curves
        tell nothing of the wall. The decision is "cannot be judged" where an evidence that might
        change it is not to be trusted, or, with `none_below`, where there is no p-value.
        ``class_verdict`` (class_label)
        says how far the fits of the classes can be trusted, see
        :func:`~pymc_hyperelastic.diagnose_evidence`.

        ``error`` says why what was given up could not be judged, and is empty otherwise.

    Warns
    -----
    UserWarning
        If specimens stand in the training data of classes with variability, with other
        measurements; if something cannot be judged; if an interrupt leaves something unknown.

    Raises
    ------
    TypeError, ValueError
        If the data are unsound or were in the training data, `classes` are not fitted classes of
        one model, one of them could not be fitted and there is no `class_prior`, or that is not a
        probability of each class.

    See Also
    --------
    fit_classes, explain_classification, plot_class_probability

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
    classification = Classification(
        classes,
        new_data,
        by=by,
        class_prior=class_prior,
        average_over=average_over,
        undecided_below=undecided_below,
        none_below=none_below,
        random_seed=seed_kept(random_seed, store).entropy,
    )
    classification.check_new(new_data)
    units = units_of(new_data, by)
    with (progress := create_simple_progress(progressbar)):
        bar = progress.add_task("Classifying", completed=0, total=len(units))
        advance = partial(progress.advance, bar)
        if store is None:
            result = classification.of(new_data, advance, interruptible=True)
        else:
            kept = Store(store, classification.manifest(new_data))
            rows = []
            for i, tests in enumerate(units.values()):
                judge = partial(classification.of, tests_at(new_data, tests))
                rows.append(kept.remember(f"{by}-{i}", judge))
                advance()
            result = xr.concat(rows, by, **_ROWS)
    warn_of_doubt(result)
    return result
