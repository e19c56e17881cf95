"""Shapley values of a classification: which parts of the model or data drive it."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal

import xarray as xr
from pymc.progress_bar import create_simple_progress

from pymc_hyperelastic.classes.classification import Classification
from pymc_hyperelastic.data.inflation import check_data
from pymc_hyperelastic.data.representatives import representatives
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
    r"""Divide the log evidence ratio of a class and its most probable rival into Shapley values.

    Let ``v(S)`` be the log evidence of a specimen under a class in which the set ``S`` of the ``n``
    parts is replaced with the parts of the rival. The contribution of part ``j`` is its Shapley
    value [1]_,

    .. math:: φ_j = \sum_{S \not\ni j} \frac{|S|! \, (n - 1 - |S|)!}{n!} \,
        \bigl[v(S) - v(S \cup \{j\})\bigr], \qquad
        \sum_j φ_j = \ln\frac{P(D | C)}{P(D | C_{\mathrm{rival}})}

    the mean change over all orders in which parts can be replaced. It is positive if the part
    favours the class.

    With variability the parts are ``"material"`` (location, spreads and correlation of the
    coordinates), ``"experiments"`` (spread between experiments on a specimen) and ``"noise"`` (size
    of the measurement error), as far as the classes have them. Without variability, they are the
    measured signals ``"pressure"``, ``"slope"`` and ``"force"``.

    Parameters
    ----------
    new_data, classes, by, class_prior, average_over, random_seed, progressbar
        As in :func:`classify`; the same seed gives the same evidences.

    Returns
    -------
    xarray.Dataset
        ``rival`` (test or specimen, class_label), the most probable other class, and
        ``log_ratio_part`` (test or specimen, class_label, part), the Shapley values in nats; NaN if
        an evidence is unreliable or its standard error exceeds half a nat.

    Warns
    -----
    UserWarning
        If the evidences of a row cannot be computed.

    Raises
    ------
    TypeError, ValueError
        As in :func:`classify`, or if there is only one class.

    See Also
    --------
    classify

    Notes
    -----
    If signals are the parts, ``v(S)`` is the sum of two log evidences: that of the signals in ``S``
    under the rival, and that of the other signals under the class. Slopes are differences of the
    measured pressures. Together with the pressures, the slopes enter with their term of the
    likelihood; without the pressures, they count as independent measurements with the errors that
    the likelihood assigns. Information that pressures and slopes share is divided between them.

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
    check_data(new_data)
    classification = Classification(
        classes,
        representatives(new_data),
        by=by,
        class_prior=class_prior,
        average_over=average_over,
        random_seed=random_seed,
    )
    if len(classification.names) < 2:
        raise ValueError(
            f"classes holds only {classification.names[0]!r}: an explanation compares evidences of "
            "two classes or more"
        )
    classification.check_new(new_data)
    with (progress := create_simple_progress(progressbar)):
        bar = progress.add_task("Explaining", completed=0, total=len(units_of(new_data, by)))
        return classification.explanation(new_data, partial(progress.advance, bar))
