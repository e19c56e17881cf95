"""Fit many specimens, each by itself."""

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import check_data
from pymc_hyperelastic.data.representatives import representatives
from pymc_hyperelastic.data.select import tests_at, units_of
from pymc_hyperelastic.data.variables import kinds_of_tests, sheet_tests
from pymc_hyperelastic.evidence.batched import BatchedFunction, without_traces
from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.evidence.integral import integrate
from pymc_hyperelastic.evidence.keeping import seed_kept
from pymc_hyperelastic.evidence.limits import mass_at_limits
from pymc_hyperelastic.evidence.smc import seed_of, seed_sequence
from pymc_hyperelastic.evidence.target import Target
from pymc_hyperelastic.io.batches import (
    DOUBTFUL,
    Prepared,
    UnitWork,
    failure,
    joined,
    labels_of,
    run_in_batches,
    warn_of,
)
from pymc_hyperelastic.io.open import GROUP, open_result
from pymc_hyperelastic.io.store import Store
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.models.checks import LARGEST_CURVE_ERROR, doubts_of_fit
from pymc_hyperelastic.models.forward import ForwardModel, until_accurate
from pymc_hyperelastic.models.geometry import MeasuredValue, complete_unknowns, split_by_owner
from pymc_hyperelastic.models.inflation import build_model
from pymc_hyperelastic.models.likelihoods import Likelihood, as_likelihood
from pymc_hyperelastic.models.priors import (
    FEW_DRAWS,
    prior_from_record,
    prior_to_record,
    priors_from_records,
)
from pymc_hyperelastic.models.settings import ModelSettings
from pymc_hyperelastic.parallel import LOCK
from pymc_hyperelastic.predictions.conditions import Conditions, as_conditions
from pymc_hyperelastic.predictions.members import posterior_of
from pymc_hyperelastic.predictions.properties import tube_properties

# Quantiles that are kept of the posterior of a property.
QUANTILES = {"2.5 %": 0.025, "50 %": 0.5, "97.5 %": 0.975}


@dataclass(frozen=True)
class Fitting(UnitWork):
    """A model, and the summary of its posterior that is kept of each specimen or experiment."""

    name: ClassVar[str] = "fit_cohort"

    by: str
    energy: StrainEnergy | Sequence[Layer]
    like: xr.Dataset
    record: dict[str, Any]
    """Record of the likelihood: distributions cannot be sent to a worker."""
    priors: dict[str, Any]
    """Records of the priors."""
    geometry: dict[str, Any]
    at: Conditions | None
    """At which the elastic properties are kept; None keeps none."""
    draws: int
    random_seed: Any

    def manifest(self) -> dict[str, Any]:
        """The law, priors and settings."""
        return {
            "settings": asdict(ModelSettings.of(self.energy)),
            "likelihood": self.record,
            "priors": self.priors,
            "geometry": self.geometry,
            "at": _as_json(self.at),
            "draws": self.draws,
            "random_seed": self.random_seed,
        }

    def prepare(self) -> Prepared:
        """Set up the models of specimens."""
        return Fits(self).of

    @property
    def likelihood(self) -> Likelihood:
        """The measured signals and their errors."""
        return Likelihood.from_record(self.record)

    @property
    def unknown(self) -> dict[str, Any]:
        """Priors of the material and of the geometry."""
        geometry = {name: _distribution(record) for name, record in self.geometry.items()}
        return priors_from_records(self.priors) | geometry

    def stated(self) -> tuple[Any, dict[str, Any], dict[str, Any]]:
        """The wall, and distributions of all that is not known of it and of the tube."""
        return complete_unknowns(self.energy, self.unknown)


class Fits:
    """Posteriors of specimens, each by itself, from models that are compiled once."""

    def __init__(self, work: Fitting) -> None:
        wall, *unknown = work.stated()
        self._work = work
        self._law = " in ".join(ModelSettings.of(work.energy).laws)
        self._forward = work.likelihood.forward_model(wall, work.like, *unknown)
        self._models: dict[tuple[int, bool, bool, bool], _Model] = {}

    def of(self, data: xr.Dataset) -> xr.Dataset:
        """Result of these specimens or experiments, row by row."""
        by = self._work.by
        rows = []
        for label, tests in units_of(data, by).items():
            own = tests_at(data, tests)
            try:
                rows.append(self._row(own, label))
            except (ValueError, ArithmeticError) as error:
                rows.append(failure(own, by, str(error)))
        origin = {name: data.attrs[name] for name in ("title", "simulated") if name in data.attrs}
        return joined(rows, by).assign_attrs(origin, law=self._law)

    def _row(self, data: xr.Dataset, label: str) -> xr.Dataset:
        seed = seed_of(seed_sequence(self._work.random_seed), label)
        with_force = "axial_force" in data and bool(data["axial_force"].notnull().any())
        rng = np.random.default_rng(seed)
        key = data.sizes["test"], *kinds_of_tests(data), with_force
        if key not in self._models:
            self._models[key] = _Model(self._work, data, self._forward)
        model = self._models[key]

        def take(forward: ForwardModel) -> tuple[_Fit, tuple[Any, ...]]:
            # Other specimens keep their curves: the result of one depends on no other.
            own = model if forward is model.forward else _Model(self._work, data, forward)
            found = own.sample(data, self._work.draws, rng)
            return found, (data, *own.materials(found.posterior))

        found, accurate = until_accurate(model.forward, take, LARGEST_CURVE_ERROR)
        if not accurate:
            raise ValueError(
                f"curves of its posterior err by more than {LARGEST_CURVE_ERROR:.0e} of their "
                "largest value: its material is far from what priors expect"
            )
        return found.as_row(self._work, data)


class _Fit(NamedTuple):
    """Posterior and evidence of one specimen."""

    posterior: dict[str, np.ndarray]
    """By (draw, entry)."""
    evidence: dict[str, Any]

    def as_row(self, work: Fitting, data: xr.Dataset) -> xr.Dataset:
        by = work.by
        variables: dict[str, Any] = {}
        for name, values in self.posterior.items():
            entries = [f"{name}_entry"] if values.ndim > 1 else []
            dims = ["chain", "draw", by, *entries]
            variables[name] = (dims, values[None, :, None], {GROUP: "posterior"})
        for name, value in self.evidence.items():
            variables[name] = (by, [value], {GROUP: "evidence"})
        variables["error"] = (by, [""], {GROUP: "evidence"})
        if work.at is not None:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                variables |= self._properties(work, work.at, data)
            # A row has no other place for them, such as that a pressure was not measured.
            said = [str(w.message) for w in caught if issubclass(w.category, UserWarning)]
            texts = filter(None, [self.evidence[DOUBTFUL], *said])
            variables[DOUBTFUL] = (by, ["; ".join(texts)], {GROUP: "evidence"})
        coords = labels_of(data, by) | {"chain": [0], "draw": np.arange(work.draws)}
        return xr.Dataset(variables, coords)

    def _properties(self, work: Fitting, at: Conditions, data: xr.Dataset) -> dict[str, Any]:
        posterior = posterior_of({name: values[None] for name, values in self.posterior.items()})
        tree = xr.DataTree.from_dict({"posterior": posterior, "constant_data": data})
        found = tube_properties(tree, at, energy=work.energy)
        quantiles = found.quantile([*QUANTILES.values()], ["chain", "draw"], skipna=True)
        properties: dict[str, Any] = {
            name: (
                (work.by, *values.dims[1:], "interval"),
                np.moveaxis(values.values, 0, -1)[None],
                {**found[name].attrs, GROUP: "properties"},
            )
            for name, values in quantiles.data_vars.items()
        }
        # Each specimen has its own measured range, and number of draws without a property.
        for name, flag in found.coords.items():
            if name in ("extrapolated", "range_extrapolated", "in_vivo_extrapolated"):
                own = (work.by, *flag.dims), flag.values[None], {GROUP: "properties"}
                properties[str(name)] = own
        for _, _, attrs in properties.values():
            attrs.pop("draws_without", None)
        return properties | {"pressure": found["pressure"].variable, "interval": list(QUANTILES)}


class _Model:
    """Model of specimens with a given number of tests, whose data can be replaced."""

    @without_traces
    def __init__(self, work: Fitting, data: xr.Dataset, forward: ForwardModel) -> None:
        self._model = build_model(
            work.energy, data, work.likelihood, priors=work.unknown, forward=forward.with_data(data)
        )
        self.forward: ForwardModel = self._model.study.forward
        self._target = Target(self._model)
        free = self._model.free_RVs
        self._names = [rv.name for rv in free]
        self._chi_squares = self._model.study.chi_squares_of(self._model)
        self._constrain = BatchedFunction.of_model(
            self._model, self._model.replace_rvs_by_values(free)
        )

    def sample(self, data: xr.Dataset, draws: int, rng: np.random.Generator) -> _Fit:
        """Return the posterior and the evidence given these data."""
        self.forward.set_data(data)
        found = integrate(self._target, draws, rng)
        values = dict(zip(self._names, self._constrain(found.particles), strict=True))
        value, error = found.log_value
        evidence = {"log_evidence": value, "log_evidence_se": error, "pareto_k": found.pareto_k}
        particles = self._target.by_name(found.particles[None])
        limits = mass_at_limits(self._model, particles, self._model.study.physical_ends)
        doubtful = doubts_of_fit(limits.merge(self._chi_squares(data, found.particles)))
        return _Fit(values, evidence | {"method": found.method, DOUBTFUL: doubtful})

    def materials(self, posterior: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Return some draws of the material parameters, and of the unknown geometry."""
        some = {name: values[:FEW_DRAWS] for name, values in posterior.items()}
        return [{n: some[n] for n in names if n in some} for names in self.forward.unknown]


def fit_cohort(
    energy: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    likelihood: Likelihood | Any,
    store: str | Path | Store,
    *,
    by: Literal["specimen", "test"] = "specimen",
    priors: Mapping[str, Any] | None = None,
    at: Conditions | float | Sequence[float] | None = None,
    draws: int = 500,
    random_seed: Any = None,
    progressbar: bool = True,
) -> xr.DataTree:
    """Sample many specimens separately, in batches, and keep finished batches in a folder.

    The model of each specimen is :func:`~pymc_hyperelastic.inflation_model` of its own tests. Its
    seed follows from its name: the result does not depend on the other specimens, the computer or
    the order.

    A batch is finished when its part of the store is complete. After an interrupt or a kill, the
    same call continues. A specimen that cannot be sampled becomes a row with an error message. A
    process that dies is replaced, and its batch is tried again and then halved, until the specimen
    at fault is alone; the next call tries that specimen again.

    Parameters
    ----------
    energy : StrainEnergy or list of Layer
        The material.
    data : xarray.Dataset
        Inflation data of the cohort.
    likelihood : Gaussian, SlopeAugmented, float or distribution
        The measured quantities and their errors, see
        :func:`~pymc_hyperelastic.inflation_model`; distributions with numbers for parameters.
    store : Store, str or Path
        The folder, and who computes; see :class:`Store`.
    by : {"specimen", "test"}
        Unit of a fit: all experiments on a specimen together, or each experiment.
    priors : dict of str to distribution or MeasuredValue, optional
        See :func:`~pymc_hyperelastic.inflation_model`; distributions of PyMC with numbers for
        parameters, which can be written down.
    at : Conditions, float or sequence of float, optional
        Pressures (kPa, or with their unit in :class:`~pymc_hyperelastic.Conditions`) at which the
        elastic properties of each specimen are kept, as median and 95 % interval; see
        :func:`~pymc_hyperelastic.tube_properties`. ``extrapolated`` says at which pressures of
        each specimen. By default no properties are kept.
    draws : int, default 500
        Draws of each posterior.
    random_seed : int, optional
        The same seed gives the same result. Without one it is chosen, and kept in the store.
    progressbar : bool
        Whether to show progress.

    Returns
    -------
    xarray.DataTree
        The result, as :func:`open_result` reads it from the store. Each variable is read when it is
        needed.

    See Also
    --------
    Store, open_result, classify

    Raises
    ------
    TypeError, ValueError
        If data, priors or numbers are unsound, before anything is computed; if the store holds
        other work.
    OSError
        If the store cannot be written, or no worker is left. Finished batches are kept.

    Warns
    -----
    UserWarning
        If a specimen of the store failed, or its fit is doubtful: the posterior is at a limit of a
        prior, or its best curve is further from the data than the noise explains; if a part of the
        store is damaged: it is computed again.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen=["S1", "S2"])
    >>> likelihood = ph.Gaussian(pressure_sd=0.5)
    >>> settings = {"random_seed": 1, "progressbar": False}
    >>> store = ph.Store("fitted", cores=1)
    >>> cohort = ph.fit_cohort(ph.Ogden(), data, likelihood, store, **settings)
    >>> cohort["evidence"]["error"].values.tolist()
    ['', '']
    """
    check_count("draws", draws, 2)
    if by not in ("specimen", "test"):
        raise ValueError(f"by must be 'specimen' or 'test', not {by!r}")
    conditions = None if at is None else as_conditions(at)
    if conditions is not None:
        conditions.in_kilopascal("warn")  # before anything is computed
        _check_tubes(data, by, conditions)
    material, tube = split_by_owner(energy, "priors", priors)
    work = Fitting(
        by,
        energy,
        representatives(data),
        as_likelihood(likelihood).to_record(),
        {name: prior_to_record(name, prior) for name, prior in material.items()},
        {name: _record(name, value) for name, value in tube.items()},
        conditions,
        int(draws),
        seed_kept(random_seed, store).entropy,
    )
    with LOCK:  # not around the batches: workers may be threads of this process
        wall, *unknown = work.stated()
        work.likelihood.check(wall, data, *unknown, together=by == "specimen")
    remarks = run_in_batches(work, work.manifest(), data, store, progressbar=progressbar)
    warn_of(remarks, len(units_of(data, by)))
    found = open_result(store)
    assert isinstance(found, xr.DataTree)
    return found


def _check_tubes(data: xr.Dataset, by: str, at: Conditions) -> None:
    """Raise unless a tube is known whose properties are asked for, also of sheets."""
    check_data(data)
    sheets = sheet_tests(data)
    alone = [label for label, tests in units_of(data, by).items() if sheets[tests].all()]
    if alone and "inner_radius" not in at.geometry():
        raise ValueError(
            f"{by} {alone[0]!r} holds no tube, only sheets, and `at` asks for properties of tubes: "
            "state the tube, at=ph.Conditions(..., tube=ph.Tube(...)), or leave `at` away"
        )


def _record(name: str, value: Any) -> Any:
    return {"sd": value.sd} if isinstance(value, MeasuredValue) else prior_to_record(name, value)


def _distribution(record: Any) -> Any:
    return MeasuredValue(record["sd"]) if isinstance(record, dict) else prior_from_record(record)


def _as_json(at: Conditions | None) -> Any:
    """Return conditions in JSON types, as the manifest stores them."""
    stated = None if at is None else asdict(at)
    return json.loads(json.dumps(stated, default=lambda value: np.asarray(value).tolist()))
