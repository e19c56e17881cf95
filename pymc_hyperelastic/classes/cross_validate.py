"""Cross-validation of classes: classify specimens by classes that were fitted without them."""

import json
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr
from pymc.progress_bar import create_simple_progress
from scipy.special import logsumexp, softmax

from pymc_hyperelastic.classes.average import Laws, error_of_mean, labels_of
from pymc_hyperelastic.classes.classification import is_unreliable, tabulate
from pymc_hyperelastic.classes.fit import check_groups, manifest_of
from pymc_hyperelastic.classes.interface import FEWEST_DRAWS, ClassKind, Fold, Groups
from pymc_hyperelastic.classes.kinds import kind_of_settings
from pymc_hyperelastic.classes.training import check_left_out
from pymc_hyperelastic.data.inflation import check_data
from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.keeping import Remember, named, remembering, seed_kept
from pymc_hyperelastic.evidence.verdicts import BAD, worst_of
from pymc_hyperelastic.mechanics.layers import Layer, check_energy, check_layers
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.models.variability import Variability
from pymc_hyperelastic.parallel import one_thread


@one_thread
def cross_validate(
    energy: StrainEnergy | Sequence[StrainEnergy | Layer | Sequence[Layer]],
    groups: Mapping[str, xr.Dataset],
    likelihood: Likelihood | Any,
    *,
    variability: Variability | Literal["specimen"] | None = "specimen",
    priors: dict[str, Any] | None = None,
    leave_out: Mapping[str, Hashable] | None = None,
    draws: int = 1000,
    random_seed: Any = None,
    progressbar: bool = True,
    store: str | Path | None = None,
) -> xr.Dataset:
    r"""Leave out specimens in turn, and classify them by classes fitted to the other specimens.

    Class probabilities are calibrated if, among left-out specimens with probability ``p`` of a
    class, a fraction ``p`` belongs to it. The posteriors of the classes and the probabilities of
    strain energies do not depend on the specimens that are left out. With variability, starting
    points and proposals of the fits are computed once from all specimens: they influence the errors
    of the results, but not their expectations.

    Parameters
    ----------
    energy : StrainEnergy or sequence of StrainEnergy
        The material, or a list of layers as in :func:`fit_classes`. With several strain energies,
        results are computed for each of them and for their average, weighted with the evidences of
        the specimens that are not left out; p-values are averaged with the same weights. Strain
        energies of one type, such as ``OgdenSeries(1)`` and ``OgdenSeries(2)``, are labelled with
        their settings.
    groups : dict of str to xarray.Dataset
        Data by the name of the group, which is also that of its class, as for :func:`fit_classes`.
    likelihood, variability, priors
        See :func:`~pymc_hyperelastic.fit_classes`.
    leave_out : dict of str to hashable, optional
        Label of each specimen, such as its animal: specimens of one label are left out together. By
        default each specimen is left out separately.
    draws : int, default 1000
        Number of posterior draws of each class, at least 100.
    random_seed : int, optional
        Seed of the random numbers; the same seed gives the same result.
    progressbar : bool
        Whether to show progress. After an interrupt, results that are not yet computed are NaN.
    store : str or Path, optional
        Folder in which the results of each fit are stored. After an interrupt, the same call
        continues from there.

    Returns
    -------
    xarray.Dataset
        ``class_probability`` and ``log_evidence``, with its standard error ``log_evidence_se``
        (strain_energy, specimen, class_label), and ``log_score`` and ``brier_score``
        (strain_energy, specimen). ``verdict`` (strain_energy, specimen) is the reliability of the
        fits without the specimen. It is "not to be trusted" if an evidence of the specimen is
        unreliable, see :func:`classify`. With variability also ``p_value`` (strain_energy,
        specimen, class_label). With several strain energies, the last entry of ``strain_energy``
        is ``"average"``, and the weights are ``strain_energy_probability`` (strain_energy,
        specimen) with the standard errors ``strain_energy_probability_se``.
        Specimens have the coordinates ``true_class`` and ``left_out``, their label. Log evidences
        and log scores are in nats. For one strain energy, ``class_probability`` and ``true_class``
        can be passed to :func:`~pymc_hyperelastic.score_probabilities`, and its result to
        :func:`~pymc_hyperelastic.plot_reliability`.

    Raises
    ------
    TypeError, ValueError
        If data, priors or numbers are invalid, a specimen is in two groups or not in `leave_out`,
        two specimens that are not left out together have the same curve, or a class would have no
        specimen left.

    See Also
    --------
    score_probabilities, plot_reliability

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> scores = ph.cross_validate(
    ...     ph.Ogden(),
    ...     {name: ph.select(data, group=name) for name in ("C1", "C2")},
    ...     ph.Gaussian(pressure_sd=4 * ph.mmHg),
    ...     draws=500,
    ...     random_seed=1,
    ...     progressbar=False,
    ... )
    >>> scores["log_score"].sizes["specimen"]
    5
    """
    energies = _walls(energy)
    check_count("draws", draws, FEWEST_DRAWS)
    check_groups(groups)
    for data in groups.values():
        check_data(data)
    # Names of specimens may be numbers: convert them to text, as in `leave_out` and in results.
    groups = {
        name: data.assign_coords(specimen=data["specimen"].astype(str))
        for name, data in groups.items()
    }
    true_class = _true_classes(groups)
    units = _units(true_class, leave_out)
    _check_left(groups, true_class, units)
    check_left_out(groups, units)
    kinds = [kind_of_settings(law, likelihood, priors, variability) for law in energies]
    for kind in kinds:
        kind.check_groups(groups)
    seed = seed_kept(random_seed, store)
    remember = remembering(
        store,
        lambda: manifest_of(
            "cross_validate",
            groups,
            seed,
            laws=[asdict(kind.settings()) for kind in kinds],
            left_out={specimen: str(unit) for specimen, unit in units.items()},
            draws=draws,
        ),
    )
    folds = {
        label: _folds(kind, groups, of_law, draws, named(f"law-{i}", remember))
        for i, (label, kind, of_law) in enumerate(
            zip(labels_of(kinds), kinds, seed.spawn(len(kinds)), strict=True)
        )
    }
    found = _leave_out_each(folds, list(groups), units, progressbar)
    if len(folds) > 1:
        found = _with_average(found)
    unused = ["training_evidence", "training_evidence_se"]
    result = _with_scores(
        found.drop_vars(unused if kinds[0].has_p_value else [*unused, "p_value"]).assign_coords(
            true_class=("specimen", list(true_class.values())),
            left_out=("specimen", [str(unit) for unit in units.values()]),
        )
    )
    return result.assign_attrs(variability=kinds[0].stored_as, random_seed=json.dumps(seed.entropy))


def _walls(energy: Any) -> list[Any]:
    """Return the list of materials or walls; a sequence that contains a Layer is a single wall."""
    several = isinstance(energy, list | tuple)
    walls = list(energy) if several and not any(isinstance(e, Layer) for e in energy) else [energy]
    if not walls:
        raise ValueError("energy holds no strain energy")
    for wall in walls:
        (check_layers if isinstance(wall, list | tuple) else check_energy)(wall)
    return walls


def _true_classes(groups: Groups) -> dict[str, str]:
    """Return the class of each specimen; ValueError if a name occurs in two groups."""
    true_class: dict[str, str] = {}
    for name, data in groups.items():
        for specimen in dict.fromkeys(data["specimen"].values.tolist()):
            if specimen in true_class:
                raise ValueError(
                    f"specimen {specimen!r} is in the groups {true_class[specimen]!r} and "
                    f"{name!r}: give each specimen a unique name"
                )
            true_class[specimen] = name
    return true_class


def _units(
    true_class: Mapping[str, str], leave_out: Mapping[str, Hashable] | None
) -> dict[str, Hashable]:
    """Return the label of each specimen: specimens of one label are left out together."""
    if leave_out is None:
        return {specimen: specimen for specimen in true_class}
    if not isinstance(leave_out, Mapping):
        raise TypeError(
            "leave_out must be a dict from names of specimens to labels such as their animals, not "
            f"{type(leave_out).__name__}"
        )
    units = {str(specimen): unit for specimen, unit in leave_out.items()}
    # NaN, as of an empty cell of a table, differs from itself.
    lacking = [s for s in true_class if s not in units or units[s] != units[s]]
    if lacking:
        raise ValueError(
            f"leave_out has no label for specimen {lacking[0]!r}: give one for each specimen"
        )
    return {specimen: units[specimen] for specimen in true_class}


def _check_left(
    groups: Groups, true_class: Mapping[str, str], units: Mapping[str, Hashable]
) -> None:
    """Raise ValueError if a group consists of specimens that are left out together."""
    for unit in dict.fromkeys(units.values()):
        for name in groups:
            if all(units[s] == unit for s, of in true_class.items() if of == name):
                raise ValueError(
                    f"group {name!r} has no specimen left without {unit!r}: a class needs at least "
                    "one specimen that is not left out"
                )


# Function of the number of a fold and of the specimens that it leaves out. Its dataset holds, for
# these specimens, the variables of ``_leave_out_each``.
Folds = Callable[[int, Collection[str]], xr.Dataset]


def _leave_out_each(
    folds: Mapping[str, Folds],
    names: Sequence[str],
    units: Mapping[str, Hashable],
    progressbar: bool,
) -> xr.Dataset:
    """Fit without each unit in turn, for each strain energy, and classify its specimens.

    Returns
    -------
    xarray.Dataset
        Predictions (strain_energy, specimen, class_label), and for (strain_energy, specimen) the
        log evidence of all other specimens, and the ``verdict`` on it and on the predictions. NaN,
        and an empty verdict, for specimens that are not yet computed.
    """
    every_unit = list(dict.fromkeys(units.values()))
    coords = {"strain_energy": list(folds), "specimen": list(units), "class_label": list(names)}
    table = xr.DataArray(np.nan, coords, list(coords))
    of_fit = table.isel(class_label=0, drop=True)
    found = xr.Dataset(
        {name: table.copy() for name in ("log_evidence", "log_evidence_se", "p_value")}
        | {name: of_fit.copy() for name in ("training_evidence", "training_evidence_se")}
        | {"verdict": xr.full_like(of_fit, "", "U20")}
    )
    with (progress := create_simple_progress(progressbar)):
        total = len(folds) * (1 + len(every_unit))
        bar = progress.add_task("Leaving out", completed=0, total=total)
        try:
            for law, fold in folds.items():
                progress.advance(bar)
                for number, unit in enumerate(every_unit):
                    held = fold(number, [s for s in units if units[s] == unit])
                    place = {"strain_energy": law, "specimen": held["specimen"].values}
                    for name, values in held.items():
                        found[name].loc[place] = values.values
                    progress.advance(bar)
        except KeyboardInterrupt:
            warn_user("interrupted: specimens not yet classified are NaN")
    return found


def _folds(
    kind: ClassKind, groups: Groups, seed: np.random.SeedSequence, draws: int, remember: Remember
) -> Folds:
    """Return the folds of one strain energy, each stored once it is computed."""

    @cache
    def setup() -> Callable[[Collection[str], int], Fold]:
        # Common to all folds, and needed for the first one that is not stored.
        return kind.leave_out(groups, seed, remember)

    def compute(left_out: Collection[str]) -> xr.Dataset:
        training, verdict, predictions = setup()(left_out, draws)
        prior, rows = np.full(len(groups), 1 / len(groups)), [*predictions.values()]
        table = tabulate(rows, prior, "specimen", [*groups]).assign(class_verdict=verdict)
        return xr.Dataset(
            {
                **table[["log_evidence", "log_evidence_se", "p_value"]],
                "training_evidence": training.value,
                "training_evidence_se": training.standard_error,
                "verdict": ("specimen", np.where(is_unreliable(table, prior), BAD, verdict)),
            },
            {"specimen": [*predictions]},
        )

    return lambda number, left_out: remember(f"fold-{number}", lambda: compute(left_out))


def _with_average(found: xr.Dataset) -> xr.Dataset:
    """Add probabilities of the strain energies, and averages weighted with them as a last entry."""
    labels, dims = found["strain_energy"].values.tolist(), ("strain_energy", "specimen")
    training = np.stack([found["training_evidence"], found["training_evidence_se"]], axis=-1)
    of_specimens = [
        Laws(labels, [], [Estimate(*law) for law in of_laws.tolist()])
        for of_laws in np.moveaxis(training, 1, 0)
    ]
    log_weight = xr.DataArray(np.transpose([o.log_probability for o in of_specimens]), dims=dims)
    error = np.transpose([of_specimen.probability_error for of_specimen in of_specimens])
    found = found.assign(
        strain_energy_probability=np.exp(log_weight), strain_energy_probability_se=(dims, error)
    )
    terms = found["log_evidence"] + log_weight
    value = terms.reduce(logsumexp, "strain_energy")
    errors = error_of_mean(np.exp(terms - value).values, found["log_evidence_se"].values)
    p_value = (np.exp(log_weight) * found["p_value"]).sum("strain_energy", skipna=False)
    average = xr.full_like(found.isel(strain_energy=0), np.nan).assign(
        log_evidence=value,
        log_evidence_se=(value.dims, errors),
        p_value=p_value,
        verdict=("specimen", [worst_of(verdicts) for verdicts in found["verdict"].values.T]),
    )
    return xr.concat([found, average.assign_coords(strain_energy="average")], "strain_energy")


def _with_scores(result: xr.Dataset) -> xr.Dataset:
    """Return the result with the class probabilities, and the scores of each specimen."""
    log_evidence = result["log_evidence"]
    probability = log_evidence.copy(data=softmax(log_evidence, axis=-1))
    computed = probability.notnull().all("class_label")
    of_truth = xr.where(computed, probability.sel(class_label=result["true_class"]), np.nan)
    truth = (result["class_label"] == result["true_class"]).astype(float)
    result = xr.Dataset({"class_probability": probability}).assign(result)
    with np.errstate(divide="ignore"):
        result["log_score"] = np.log(of_truth).drop_vars("class_label")
    result["brier_score"] = ((probability - truth) ** 2).sum("class_label", skipna=False)
    return result
