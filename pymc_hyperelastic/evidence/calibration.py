"""Simulation-based calibration: compare posteriors with parameters that are known."""

import json
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pymc as pm
import pytensor
import xarray as xr
from arviz_base import dict_to_dataset, xarray_sel_iter
from arviz_base.labels import BaseLabeller
from numpy.typing import NDArray
from pymc.backends.arviz import coords_and_dims_for_inferencedata
from pymc.progress_bar import create_simple_progress
from scipy.stats import chisquare

from pymc_hyperelastic.evidence.batched import BatchedFunction, side_by_side
from pymc_hyperelastic.evidence.checks import check_count, check_names, check_shape
from pymc_hyperelastic.evidence.keeping import Remember, remembering, seed_kept
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.parallel import one_thread


@one_thread
def simulation_based_calibration(
    model: pm.Model,
    *,
    simulations: int = 300,
    draws: int = 500,
    ranked_draws: int = 99,
    var_names: Sequence[str] | None = None,
    simulator: pm.Model | None = None,
    random_seed: Any = None,
    progressbar: bool = True,
    store: str | Path | None = None,
    **kernel_settings: Any,
) -> xr.Dataset:
    r"""Check by simulation that a model's posteriors are as wide, and lie where, they should.

    Parameters ``θ`` are drawn from the prior, data ``y`` from the likelihood at ``θ``, and the
    posterior given ``y`` is sampled. If model and sampler are right, the rank of each entry of
    ``θ`` among ``L`` independent draws ``θ₁ … θ_L`` of the posterior is uniform [1]_:

    .. math:: r = \sum_{l=1}^{L} 1[θ_l < θ], \qquad P(r = k) = \frac{1}{L + 1},
        \quad k = 0, \dots, L

    Ranks pile up at both ends if posteriors are too narrow, in the middle if they are too wide, and
    at one end if they are biased.

    Parameters
    ----------
    model : pymc.Model
        Any model with continuous free variables and observed variables. The observed values are
        replaced by simulated ones; the model itself is left as it is.
    simulations : int, default 300
        Number of simulated data sets, each of which is fitted by itself.
    draws : int, default 500
        Particles of each fit, one chain of :func:`pymc_hyperelastic.sample_smc`.
    ranked_draws : int, default 99
        ``L``, the number of particles, chosen at random, among which a true value is ranked. Among
        a fifth of all particles, hardly any are equal. Ties are broken at random.
    var_names : sequence of str, optional
        Variables that are ranked, deterministics among them; all free variables when missing.
    simulator : pymc.Model, optional
        Another model, with variables of the same names, from which parameters and data are drawn.
        With it one sees whether a wrong model would be found out.
    random_seed : int or sequence of int, optional
        One seed for the whole; the same seed gives the same result.
    progressbar : bool
        Whether to show progress. After an interrupt the simulations already complete are returned.
    store : str or Path, optional
        A folder that keeps each simulation that was fitted: the same call continues from there.
    **kernel_settings
        Further settings of :class:`pymc_hyperelastic.BatchedSMC`, such as ``threshold``.

    Returns
    -------
    xarray.Dataset
        ``rank``, ``truth``, ``posterior_mean`` and ``posterior_sd``, each (simulation, parameter),
        and ``p_value`` (parameter). The coordinate ``parameter`` names each entry, as in ``mu`` or
        ``k[0, 1]``, and ``variable`` the variable that it belongs to. Attributes hold the settings
        and the number of ``bins`` of the test.

    Raises
    ------
    TypeError
        If the model or the simulator is no PyMC model, or a number is not a whole one.
    ValueError
        If the model has no observed variables, or has Potentials or discrete free variables; if a
        variable is unknown, or the simulator lacks it; if simulated data are not finite; or if a
        posterior cannot be sampled.

    See Also
    --------
    plot_calibration_ranks : The figure that belongs to it.

    Notes
    -----
    ``p_value`` is that of Pearson's chi-square test of uniform ranks. There are as many bins of
    equal width, up to 20, as divide ``L + 1`` and hold ten ranks at least on average; with fewer
    than 20 simulations, or if no such number divides ``L + 1``, the p-value is NaN. Each parameter
    is tested by itself: of twenty, one has a p-value below 0.05 by chance.

    A posterior that ignores the data, and equals the prior, passes too. Compare
    ``posterior_sd`` with the spread of ``truth`` to see how informative the data are.

    References
    ----------
    .. [1] S. Talts, M. Betancourt, D. Simpson, A. Vehtari and A. Gelman, Validating Bayesian
       inference algorithms with simulation-based calibration, arXiv:1804.06788 (2018).

    Examples
    --------
    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> with pm.Model() as model:
    ...     mean = pm.Normal("mean", 0, 1)
    ...     y = pm.Normal("y", mean, 1, observed=[0.0, 0.0, 0.0])
    >>> sbc = ph.simulation_based_calibration(
    ...     model, simulations=40, draws=200, random_seed=1, progressbar=False
    ... )
    >>> dict(sbc["rank"].sizes)
    {'simulation': 40, 'parameter': 1}
    >>> bool(sbc["p_value"].sel(parameter="mean") > 0.01)
    True
    """
    check_count("simulations", simulations, 2)
    check_count("ranked_draws", ranked_draws, 1)
    check_count("draws", draws, ranked_draws)
    _check_simulates("model", model)
    names = _ranked_variables(model, var_names)
    observed = [v.name for v in model.observed_RVs]
    if simulator is not None:
        _check_simulates("simulator", simulator, [*names, *observed])
    numbers, seed = {"draws": draws, "ranked_draws": ranked_draws}, seed_kept(random_seed, store)
    seeds = seed.generate_state(1 + simulations).tolist()
    variables = [(simulator or model)[name] for name in (*names, *observed)]
    # Drawn a few hundred times, in all: not worth the time that other modes take to compile.
    drawn = pm.draw(variables, simulations, random_seed=seeds.pop(), mode="FAST_COMPILE")
    simulated = {v.name: np.asarray(x) for v, x in zip(variables, drawn, strict=True)}
    _check_simulated(model, simulated, names)

    truth = side_by_side([simulated[name] for name in names])
    compare = _comparison(model, names, simulated, truth, ranked_draws, draws, kernel_settings)

    def manifest() -> dict[str, Any]:
        arrays = {k: ([f"{k}_{i}" for i in range(v.ndim)], v) for k, v in simulated.items()}
        return {
            "work": "simulation_based_calibration",
            "simulations": xr.Dataset(arrays),
            "model": [v.name for v in model.value_vars],
            "settings": {**numbers, **kernel_settings},
            "random_seed": seed.entropy,
        }

    compared = _compared(compare, seeds, progressbar, remembering(store, manifest))
    rank = compared["rank"].values
    bins = _number_of_bins(len(rank), ranked_draws)
    entries = [_entries(model, name, simulated[name].shape[1:]) for name in names]
    calibration = compared.assign(
        truth=(("simulation", "parameter"), truth[: len(rank)]),
        p_value=("parameter", _uniformity(rank, bins, ranked_draws)),
    ).assign_coords(
        simulation=range(len(rank)),
        parameter=list(chain(*entries)),
        variable=("parameter", np.repeat(names, [len(labels) for labels in entries])),
    )
    return calibration.assign_attrs(numbers, bins=bins, random_seed=json.dumps(seed.entropy))


def _check_simulates(what: str, model: Any, names: Sequence[str] = ()) -> None:
    """Raise unless data can be drawn from the model, and it has these variables."""
    if not isinstance(model, pm.Model):
        raise TypeError(f"the {what} must be a pm.Model, not {type(model).__name__}")
    if model.potentials:
        raise ValueError(
            f"the {what} has the Potentials {[v.name for v in model.potentials]}: they have a "
            "density, but nothing can be drawn from them; give the likelihood as observed "
            "variables, as ph.Gaussian(..., observed=True) does, and leave others out"
        )
    if not model.observed_RVs:
        raise ValueError(f"the {what} has no observed variables: there are no data to simulate")
    if lacking := [name for name in names if name not in model.named_vars]:
        raise ValueError(f"the {what} has no variables {lacking}, which the model has")


def _ranked_variables(model: pm.Model, var_names: Sequence[str] | None) -> list[str]:
    check_names(var_names, [v.name for v in model.unobserved_RVs])
    if var_names is None:
        return [v.name for v in model.free_RVs]
    if not var_names:
        raise ValueError("var_names is empty: name at least one variable that is ranked")
    return list(dict.fromkeys(var_names))


def _check_simulated(model: pm.Model, simulated: dict[str, Array], parameters: list[str]) -> None:
    """Raise unless all is finite, and of the shape that the model has."""
    for name, values in simulated.items():
        check_shape(f"the simulator's {name!r}", values.shape[1:], model[name].type.shape)
        bad = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
        if bad.any():
            first = int(bad.argmax())
            at = ", ".join(f"{p} = {simulated[p][first]}" for p in parameters)
            raise ValueError(
                f"{bad.sum()} of {len(values)} simulations have a {name!r} that is not finite, the "
                f"first of them simulation {first}, at {at}: give priors under which data are "
                "finite"
            )


def _comparison(
    model: pm.Model,
    names: Sequence[str],
    simulated: dict[str, Array],
    truth: Array,
    ranked_draws: int,
    draws: int,
    kernel_settings: dict[str, Any],
) -> Callable[[int, int], xr.Dataset]:
    """Return a function of a simulation and a seed, by a model that is compiled once.

    It returns the ranks of true parameters among draws of their posterior, and its mean and sd.
    """
    observed = {v.name: simulated[v.name] for v in model.observed_RVs}
    data = {name: pytensor.shared(x[0], shape=x.shape[1:]) for name, x in observed.items()}
    conditioned = pm.observe(model, data)
    kernel = BatchedSMC(draws, model=conditioned, **kernel_settings)
    ranked = conditioned.replace_rvs_by_values([conditioned[name] for name in names])
    constrain = BatchedFunction.of_model(conditioned, ranked)

    def compare(simulation: int, seed: int) -> xr.Dataset:
        rng = np.random.default_rng(seed)
        for name, shared in data.items():
            shared.set_value(observed[name][simulation])
        try:
            kernel.find_reference(rng)
            kernel.temper(None, rng)
        except ValueError as error:
            raise ValueError(f"simulation {simulation}: {error}") from error
        draws = side_by_side(constrain(kernel.tempered_posterior))
        if not np.isfinite(draws).all():
            raise ValueError(
                f"simulation {simulation}: the posterior has draws that are not finite, which have "
                "no rank: choose other variables by var_names"
            )
        found = {
            "rank": _rank(truth[simulation], rng.permutation(draws)[:ranked_draws], rng),
            "posterior_mean": draws.mean(axis=0),
            "posterior_sd": draws.std(axis=0, ddof=1),
        }
        return xr.Dataset({name: ("parameter", values) for name, values in found.items()})

    return compare


def _compared(
    compare: Callable[[int, int], xr.Dataset],
    seeds: Sequence[int],
    progressbar: bool,
    remember: Remember,
) -> xr.Dataset:
    """Compare all simulations; after an interrupt return the complete simulations."""
    complete: list[xr.Dataset] = []
    with (progress := create_simple_progress(progressbar)):
        bar = progress.add_task("Calibrating", completed=0, total=len(seeds))
        try:
            for i, seed in enumerate(seeds):
                complete.append(remember(f"simulation-{i}", partial(compare, i, seed)))
                progress.advance(bar)
        except KeyboardInterrupt:
            if not complete:
                raise
            said = f"interrupted: {len(complete)} of {len(seeds)} simulations are complete"
            warnings.warn(said, skip_file_prefixes=(PACKAGE,))
    return xr.concat(complete, "simulation")


def _rank(truth: Array, posterior: Array, rng: np.random.Generator) -> NDArray[np.int64]:
    """Number of draws that are smaller than the truth, ties broken at random."""
    equal = (posterior == truth).sum(axis=0)
    return (posterior < truth).sum(axis=0) + rng.integers(0, equal + 1)


def _number_of_bins(simulations: int, ranked_draws: int) -> int:
    """Largest number of equal bins, up to 20, in which ten ranks or more are expected.

    With fewer ranks the distribution of the test is not that of chi-square; a wrong posterior
    shifts many ranks a little, which few bins show better.
    """
    most = min(max(simulations // 10, 1), 20)
    return max(n for n in range(1, most + 1) if (ranked_draws + 1) % n == 0)


def _uniformity(rank: NDArray[np.int64], bins: int, ranked_draws: int) -> Array:
    """P-value of the chi-square test of each column of ranks."""
    if bins == 1:
        return np.full(rank.shape[1], np.nan)
    in_bin = rank // ((ranked_draws + 1) // bins) == np.arange(bins)[:, None, None]
    return chisquare(in_bin.sum(axis=1)).pvalue


def _entries(model: pm.Model, name: str, shape: tuple[int, ...]) -> list[str]:
    """Label of each entry of a variable, as in ArviZ's tables."""
    coords, dims = coords_and_dims_for_inferencedata(model)
    data = dict_to_dataset({name: np.empty(shape)}, coords=coords, dims=dims, sample_dims=[])
    label = BaseLabeller().make_label_flat
    return [label(*entry) for entry in xarray_sel_iter(data)]
