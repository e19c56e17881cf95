"""How well classes predict specimens that they were not fitted to."""

import json
import warnings
from collections.abc import Hashable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import xarray as xr
from pymc.progress_bar import create_simple_progress
from scipy.special import logsumexp, softmax

from pymc_hyperelastic.classes.classify import (
    check_classes,
    check_variability,
    classify,
    fit_classes,
    labels_of,
)
from pymc_hyperelastic.classes.variable import (
    SpecimenPredictive,
    Variability,
    fit_distribution,
    sample_specimens,
)
from pymc_hyperelastic.data.inflation import check_inflation_data, tests_at
from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.evidence.smc import log_evidence, seed_sequence
from pymc_hyperelastic.mechanics.layers import check_energy
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy

__all__ = ["calibration_report"]


def calibration_report(
    energy: StrainEnergy | Sequence[StrainEnergy],
    classes: Mapping[str, xr.Dataset],
    *,
    sigma: Any,
    slope_weight: float = 0.0,
    variability: Literal["none", "specimen"] = "specimen",
    experiment_effect: bool = False,
    reference_stress: float = 20.0,
    priors: dict[str, Any] | None = None,
    leave_out: Mapping[str, Hashable] | None = None,
    draws: int = 1000,
    chains: int = 1,
    random_seed: Any = None,
    progressbar: bool = True,
) -> xr.Dataset:
    r"""Leave specimens out, one after another, and classify them by all others.

    Probabilities of classes can be trusted if specimens that took no part in a fit belong to a
    class as often as they are said to. Nothing of the specimens left out, not even the choice
    between strain energies, enters what is said of them.

    Parameters
    ----------
    energy : StrainEnergy or sequence of StrainEnergy
        The material; with several, each by itself and the average of all, in which each counts by
        the evidence of the specimens that are not left out. The p-value of the average is the mean
        of the laws' p-values by their probabilities. Laws of one class of energies, such as
        ``OgdenSeries(1)`` and ``OgdenSeries(2)``, are labelled with their settings.
    classes : dict of str to xarray.Dataset
        Data of each class by its name, as for :func:`fit_classes`.
    sigma, slope_weight, variability, experiment_effect, reference_stress, priors
        See :func:`~pymc_hyperelastic.fit_classes`.
    leave_out : dict of str to hashable, optional
        By specimen, what it belongs to: specimens of one animal, say, are left out together. Each
        specimen by itself when missing.
    draws, chains : int
        Draws of the posterior of each class.
    random_seed : int, optional
        The same seed gives the same result.
    progressbar : bool
        Whether to show progress. After an interrupt what is not yet known is NaN.

    Returns
    -------
    xarray.Dataset
        ``class_probability`` and ``log_evidence`` (strain_energy, specimen, class_label),
        ``log_score`` and ``brier_score`` (strain_energy, specimen) and, of specimens under classes
        with variability, ``p_value``. With several strain energies the last one is ``"average"``,
        and ``strain_energy_probability`` (specimen, strain_energy) tells of what. Coordinates of
        a specimen are ``true_class`` and ``left_out``. What
        :func:`~pymc_hyperelastic.score_probabilities` takes, and
        :func:`~pymc_hyperelastic.plot_reliability` shows, is in here.

    Raises
    ------
    TypeError, ValueError
        If anything is wrong with the data, priors or numbers, a specimen stands in two classes or
        not in `leave_out`, or a class has no specimen left.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> report = ph.calibration_report(
    ...     ph.Ogden(),
    ...     {name: ph.select(data, group=name) for name in ("C1", "C2")},
    ...     sigma=5 * ph.mmHg,
    ...     draws=500,
    ...     random_seed=1,
    ...     progressbar=False,
    ... )
    >>> report["log_score"].sizes["specimen"]
    5
    """
    energies: list[Any] = list(energy) if isinstance(energy, list | tuple) else [energy]
    if not energies:
        raise ValueError("energy holds no strain energy")
    for law in energies:
        check_energy(law)
    check_variability(variability, experiment_effect, reference_stress)
    check_count("draws", draws, 100)
    check_count("chains", chains, 1)
    check_classes(classes)
    for data in classes.values():
        check_inflation_data(data)
    # Names that are numbers are compared with the keys of `leave_out`, and with results, as text.
    classes = {
        name: data.assign_coords(specimen=data["specimen"].astype(str))
        for name, data in classes.items()
    }
    true_class = _true_classes(classes)
    units = _units(true_class, leave_out)
    for unit in dict.fromkeys(units.values()):
        for name in classes:
            left = [s for s, c in true_class.items() if c == name and units[s] != unit]
            if not left:
                raise ValueError(f"class {name!r} has no specimen left without {unit!r}")
    noise = {"sigma": sigma, "slope_weight": slope_weight}
    settings = {
        "experiment_effect": experiment_effect,
        "reference_stress": reference_stress,
        "priors": priors,
    }
    folds = [
        _VariableFolds(law, classes, units, noise, settings)
        if variability == "specimen"
        else _PooledFolds(law, classes, units, noise, settings)
        for law in energies
    ]
    names, specimens = list(classes), list(true_class)
    shape = len(energies), len(specimens), len(names)
    value, p_value = np.full(shape, np.nan), np.full(shape, np.nan)
    training = np.full(shape[:2], np.nan)
    seed_of_all = seed_sequence(random_seed)
    seeds = seed_of_all.spawn(len(energies))
    progress = create_simple_progress(progressbar)
    with progress:
        count = len(energies) * (1 + len(set(units.values())))
        bar = progress.add_task("Leaving out", completed=0, total=count)
        try:
            for i, (fold, seed) in enumerate(zip(folds, seeds, strict=True)):
                fold.prepare(seed)
                progress.advance(bar)
                for unit in dict.fromkeys(units.values()):
                    out = [s for s in specimens if units[s] == unit]
                    evidence, of_classes = fold(unit, out, draws, chains)
                    for specimen, (values, p_values) in of_classes.items():
                        j = specimens.index(specimen)
                        value[i, j], p_value[i, j], training[i, j] = values, p_values, evidence
                    progress.advance(bar)
        except KeyboardInterrupt:
            warnings.warn("interrupted: specimens not yet classified are NaN", stacklevel=2)
    labels = labels_of(energies)
    extra = {}
    if len(energies) > 1:
        laws = softmax(training, axis=0)
        with np.errstate(divide="ignore"):
            average = logsumexp(value + np.log(laws)[..., None], axis=0)
        value = np.concatenate([value, average[None]])
        p_value = np.concatenate([p_value, np.einsum("is,isc->sc", laws, p_value)[None]])
        extra["strain_energy_probability"] = (
            ("strain_energy", "specimen"),
            np.concatenate([laws, np.full((1, len(specimens)), np.nan)]),
        )
        labels.append("average")
    dims = ("strain_energy", "specimen", "class_label")
    report = xr.Dataset(
        {
            "class_probability": (dims, softmax(value, axis=2)),
            "log_evidence": (dims, value),
            **({"p_value": (dims, p_value)} if variability == "specimen" else {}),
            **extra,
        },
        {
            "strain_energy": labels,
            "specimen": specimens,
            "class_label": names,
            "true_class": ("specimen", [true_class[s] for s in specimens]),
            "left_out": ("specimen", [str(units[s]) for s in specimens]),
        },
        {"variability": variability, "random_seed": json.dumps(seed_of_all.entropy)},
    )
    probability = report["class_probability"]
    known = probability.notnull().all("class_label")
    chance = xr.where(known, probability.sel(class_label=report["true_class"]), np.nan)
    hit = (report["class_label"] == report["true_class"]).astype(float)
    with np.errstate(divide="ignore"):
        report["log_score"] = np.log(chance).drop_vars("class_label")
    report["brier_score"] = ((probability - hit) ** 2).sum("class_label", skipna=False)
    return report


def _true_classes(classes: Mapping[str, xr.Dataset]) -> dict[str, str]:
    """Class of each specimen."""
    true_class: dict[str, str] = {}
    for name, data in classes.items():
        for specimen in dict.fromkeys(data["specimen"].values.tolist()):
            if specimen in true_class:
                raise ValueError(
                    f"specimen {specimen!r} stands in the classes {true_class[specimen]!r} and "
                    f"{name!r}: give each specimen a name of its own"
                )
            true_class[specimen] = name
    return true_class


def _units(
    true_class: Mapping[str, str], leave_out: Mapping[str, Hashable] | None
) -> dict[str, Hashable]:
    """What each specimen is left out with."""
    if leave_out is None:
        return {specimen: specimen for specimen in true_class}
    if not isinstance(leave_out, Mapping):
        raise TypeError(
            "leave_out must be a dict of specimens to what they belong to, not "
            f"{type(leave_out).__name__}"
        )
    units = {str(specimen): unit for specimen, unit in leave_out.items()}
    lacking = [specimen for specimen in true_class if specimen not in units]
    if lacking:
        raise ValueError(f"leave_out does not say to what the specimen {lacking[0]!r} belongs")
    return {specimen: units[specimen] for specimen in true_class}


_Predictions = dict[str, tuple[list[float], list[float]]]


class _Folds:
    """One strain energy: fit the classes without some specimens, and classify those."""

    def __init__(
        self,
        energy: StrainEnergy,
        classes: Mapping[str, xr.Dataset],
        units: Mapping[str, Hashable],
        noise: dict[str, Any],
        settings: dict[str, Any],
    ) -> None:
        self.energy, self.classes, self.units = energy, classes, units
        self.noise, self.settings = noise, settings

    def prepare(self, seed: np.random.SeedSequence) -> None:
        """Do what is common to all fits."""
        self.seed = seed

    def tests_of(self, data: xr.Dataset, specimens: Sequence[str]) -> xr.Dataset:
        """Tests of the given specimens."""
        return tests_at(data, np.flatnonzero(np.isin(data["specimen"].values, list(specimens))))


class _PooledFolds(_Folds):
    """Classes whose specimens share one set of parameters."""

    def __call__(
        self, unit: Hashable, out: Sequence[str], draws: int, chains: int
    ) -> tuple[float, _Predictions]:
        """Training evidence, and of each specimen left out its evidence under every class."""
        fit, new = self.seed.spawn(2)
        train = {}
        for name, data in self.classes.items():
            stay = [s for s in data["specimen"].values.tolist() if self.units[s] != unit]
            train[name] = self.tests_of(data, stay)
        tree = fit_classes(
            self.energy,
            train,
            **self.noise,
            priors=self.settings["priors"],
            draws=draws,
            chains=chains,
            random_seed=fit.generate_state(4),
            progressbar=False,
        )
        # What an interrupt has left of the classes is of no use here: it ends the report.
        fitted = list(tree.children.values())
        if len(fitted) < len(train) or any(f["evidence"].sizes["chain"] < chains for f in fitted):
            raise KeyboardInterrupt
        predictions: _Predictions = {}
        for data in self.classes.values():
            here = [s for s in out if s in data["specimen"].values]
            if here:
                result = classify(
                    self.tests_of(data, here),
                    tree,
                    by="specimen",
                    random_seed=new.generate_state(4),
                    progressbar=False,
                )
                if (result["method"] == "").any():
                    raise KeyboardInterrupt
                for specimen in here:
                    row = result["specimen"].values.tolist().index(specimen)
                    values = result["log_evidence"].values[row].tolist()
                    predictions[specimen] = values, [np.nan] * len(values)
        return sum(log_evidence(of_class).value for of_class in fitted), predictions


class _VariableFolds(_Folds):
    """Classes whose specimens differ: each specimen is sampled only once."""

    def prepare(self, seed: np.random.SeedSequence) -> None:
        """Sample all specimens."""
        super().prepare(seed)
        rng = np.random.default_rng(seed)
        self.samplers = {name: self.model.sampler(data) for name, data in self.classes.items()}
        self.draws = {
            name: sample_specimens(self.samplers[name], data, rng)
            for name, data in self.classes.items()
        }

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        if self.noise["slope_weight"] != 0:
            raise ValueError("with variability='specimen' slope_weight must be 0")
        self.model = Variability(
            self.energy,
            self.noise["sigma"],
            self.settings["experiment_effect"],
            self.settings["reference_stress"],
            self.settings["priors"],
        )
        self.model.check_classes(self.classes)

    def __call__(
        self, unit: Hashable, out: Sequence[str], draws: int, chains: int
    ) -> tuple[float, _Predictions]:
        """Training evidence, and of each specimen left out its evidence under every class."""
        trees = {}
        for name, specimens in self.draws.items():
            stay = {s: d for s, d in specimens.items() if self.units[s] != unit}
            trees[name] = fit_distribution(self.model, stay, draws, chains, *self.seed.spawn(1))
        rng = np.random.default_rng(*self.seed.spawn(1))
        predictions: _Predictions = {}
        for name, data in self.classes.items():
            here = [s for s in out if s in self.draws[name]]
            if not here:
                continue
            predictive = SpecimenPredictive(self.model, trees, self.samplers[name])
            for specimen in here:
                found = predictive(self.tests_of(data, [specimen]), rng, self.draws[name][specimen])
                values = [p.evidence.log_evidence.value for p in found]
                predictions[specimen] = values, [p.p_value for p in found]
        return sum(log_evidence(tree).value for tree in trees.values()), predictions
