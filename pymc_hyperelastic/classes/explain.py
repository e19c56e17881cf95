"""What drives a classification."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal

import xarray as xr
from pymc.progress_bar import create_simple_progress

from pymc_hyperelastic.classes.classification import Classification
from pymc_hyperelastic.data.select import units_of
from pymc_hyperelastic.parallel import one_thread


@one_thread
def explain_classification(
    new_data: xr.Dataset,
    classes: xr.DataTree,
    *,
    by: Literal["test", "specimen"] = "test",
    class_prior: Mapping[str, float] | None = None,
    average_over: Sequence[xr.DataTree] = (),
    random_seed: Any = None,
    progressbar: bool = True,
) -> xr.Dataset:
    r"""Divide the log ratio of a class and its most probable rival into what it is made of.

    With the log evidence ``v(S)`` of a specimen under a class of which the set ``S`` of parts, out
    of ``n``, is exchanged for those of the rival, the part ``j`` is its Shapley value [1]_,

    .. math:: φ_j = \sum_{S \not\ni j} \frac{|S|! \, (n - 1 - |S|)!}{n!} \,
        \bigl[v(S) - v(S \cup \{j\})\bigr], \qquad
        \sum_j φ_j = \ln\frac{P(D | C)}{P(D | C_{\mathrm{rival}})}

    the mean change over all orders in which parts can be exchanged. It is positive where the part
    speaks for the class.

    With variability the parts are ``"material"`` (location, spreads and correlation of the
    coordinates), ``"experiments"`` (how much those on a specimen differ) and ``"noise"`` (its
    size), as far as the classes have them. Without, they are the measured signals ``"pressure"``,
    ``"slope"`` and ``"force"``.

    Parameters
    ----------
    new_data, classes, by, class_prior, average_over, random_seed, progressbar
        As given to :func:`classify`: with the same seed the evidences are the same.

    Returns
    -------
    xarray.Dataset
        ``rival`` (test or specimen, class_label), the most probable other class, and
        ``log_ratio_part`` (..., class_label, part) in nats; NaN where one of the evidences is not
        to be trusted, or known no better than to half a nat.

    Warns
    -----
    UserWarning
        If something cannot be judged.

    Raises
    ------
    TypeError, ValueError
        As :func:`classify`; if there is one class alone.

    See Also
    --------
    classify

    Notes
    -----
    A signal is exchanged when the rival predicts it by itself, and the class the others: ``v`` is
    then the sum of two log evidences, each of its own signals. Slopes are differences of the same
    pressures. Beside these they are what they add to the likelihood; without them they count as
    numbers by themselves, with the errors that the likelihood gives each. What the two say alike is
    divided between them.

    References
    ----------
    .. [1] L. S. Shapley, A value for n-person games, Contributions to the Theory of Games II (1953)
       307-317.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> classes = ph.open_result("pooled.nc")  # saved from the example of fit_classes
    >>> new = ph.select(data, specimen="S4", experiment=3)
    >>> found = ph.explain_classification(new, classes, random_seed=2, progressbar=False)
    >>> found["part"].values.tolist()
    ['pressure', 'slope']
    >>> bool(found["log_ratio_part"].sel(class_label="C2").sum("part") > 0)  # against class C1
    True
    """
    classification = Classification(
        classes,
        new_data,
        by=by,
        class_prior=class_prior,
        average_over=average_over,
        undecided_below=0.0,
        none_below=0.0,
        random_seed=random_seed,
    )
    if len(classification.names) < 2:
        raise ValueError(
            f"classes holds {classification.names[0]!r} alone: a classification is explained by "
            "what tells a class from another"
        )
    classification.check_new(new_data)
    with (progress := create_simple_progress(progressbar)):
        bar = progress.add_task("Explaining", completed=0, total=len(units_of(new_data, by)))
        return classification.explanation(new_data, partial(progress.advance, bar))
