"""Sampling by sequential Monte Carlo, and the evidence that it gives."""

import hashlib
import warnings
from collections.abc import Sequence
from inspect import signature
from typing import Any

import numpy as np
import pymc as pm
import xarray as xr
from pymc.progress_bar import SMCProgressBarManager
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.evidence.batched import BatchedFunction, without_traces
from pymc_hyperelastic.evidence.checks import check_count, check_model, check_names
from pymc_hyperelastic.evidence.diagnosis import warn_of_evidence, with_diagnosis
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.results import sampling_tree, study_of
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.parallel import one_thread


@one_thread
def sample_smc(
    model: pm.Model | None = None,
    draws: int = 2000,
    chains: int = 4,
    random_seed: Any = None,
    progressbar: bool = True,
    *,
    start: Sequence[dict[str, Array]] | None = None,
    var_names: Sequence[str] | None = None,
    **kernel_settings: Any,
) -> xr.DataTree:
    """Sample a model by sequential Monte Carlo and estimate its evidence.

    Parameters
    ----------
    model : pymc.Model, optional
        Any model with continuous variables; that of the context when missing.
    draws : int
        Number of particles of a chain.
    chains : int
        Number of independent runs.
    random_seed : int, sequence of int or numpy.random.Generator, optional
        The same seed gives the same result; from a generator one is drawn. The result holds it in
        the attribute ``random_seed``.
    progressbar : bool
        Whether to show progress. After an interrupt the chains already complete are returned.
    start : sequence of dict, optional
        Initial particles of each chain on the unconstrained scale, see :class:`BatchedSMC`.
    var_names : sequence of str, optional
        Variables to keep in the posterior; all free variables and deterministics when missing.
    **kernel_settings
        Further settings of :class:`BatchedSMC`, such as ``threshold``.

    Returns
    -------
    xarray.DataTree
        ArviZ schema: ``posterior`` and ``unconstrained_posterior`` (chain, draw), ``sample_stats``
        (chain, stage; padded with NaN where a chain had fewer stages), ``evidence`` (chain) and
        ``diagnosis``, see :func:`diagnose_evidence`; ``observed_data`` and ``constant_data`` where
        the model has such.

    Warns
    -----
    UserWarning
        If the evidence is doubtful or not to be trusted; or after an interrupt.

    Raises
    ------
    TypeError, ValueError
        If there is no model, or it is a part of another one; if it has discrete variables, nothing
        to temper, or no finite likelihood anywhere, or a setting is impossible.

    See Also
    --------
    BatchedSMC, log_evidence, diagnose_evidence

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    >>> likelihood = ph.SlopeAugmented(sigma=5 * ph.mmHg, slope_weight=3.0)
    >>> model = ph.ogden_model(data, likelihood)
    >>> tree = ph.sample_smc(model, draws=500, chains=2, random_seed=1, progressbar=False)
    >>> tree["posterior"].sizes["draw"]
    500
    >>> ph.save_result(tree, "sampled.nc")
    """
    if model is None:
        model = pm.Model.get_context(error_if_none=False)
    if model is None:
        raise TypeError("no model is given, and none is in context: give one, sample_smc(model)")
    known = [*signature(BatchedSMC).parameters]
    if strangers := [name for name in kernel_settings if name not in known]:
        raise TypeError(
            f"{strangers[0]!r} is no setting of sample_smc; expected some of {known}. All chains "
            "run in this process, whose linear algebra uses all cores"
        )
    settings = {"start": start, "var_names": var_names, **kernel_settings}
    tree = run_smc(model, draws, chains, random_seed, progressbar, **settings)
    warn_of_evidence(tree)
    return tree


def run_smc(
    model: pm.Model,
    draws: int,
    chains: int,
    random_seed: Any,
    progressbar: bool,
    *,
    start: Sequence[dict[str, Array]] | None = None,
    var_names: Sequence[str] | None = None,
    **kernel_settings: Any,
) -> xr.DataTree:
    """Return the result of :func:`sample_smc`, without a warning of its evidence."""
    check_model(model)
    check_count("chains", chains, 1)
    if start is not None and len(start) != chains:
        raise ValueError(f"start holds {len(start)} dict(s) of particles for {chains} chains")
    check_names(var_names, [v.name for v in model.unobserved_RVs])
    variables = [v for v in model.unobserved_RVs if var_names is None or v.name in var_names]
    # Chosen here if it was not given, so that every result can be had again.
    random_seed = seed_sequence(random_seed).entropy
    starts = [None] * chains if start is None else start
    kernel = BatchedSMC(draws=draws, start=starts[0], model=model, **kernel_settings)
    populations: list[Array] = []
    stats: list[list[dict[str, float]]] = []
    search, *seeds = np.random.SeedSequence(random_seed).spawn(1 + chains)
    with SMCProgressBarManager(kernel, chains, progressbar) as progress:
        if start is None:
            kernel.find_reference(np.random.default_rng(search))
        for chain, (begin, seed) in enumerate(zip(starts, seeds, strict=True)):

            def show(stages: list[dict[str, float]], chain: int = chain) -> None:
                betas = [0.0, *(stage["beta"] for stage in stages)]
                progress.update(chain, len(stages), betas[-1], betas[-2], is_last=betas[-1] == 1)

            try:
                stats.append(kernel.temper(begin, np.random.default_rng(seed), show))
            except KeyboardInterrupt:
                if not populations:
                    raise
                said = f"interrupted: {chain} of {chains} chains are complete"
                warnings.warn(said, skip_file_prefixes=(PACKAGE,))
                break
            populations.append(kernel.tempered_posterior)
    tree = particles_to_tree(kernel, populations, stats, variables, random_seed)
    return with_diagnosis(tree)


def seed_sequence(random_seed: Any) -> np.random.SeedSequence:
    """Seed sequence of a number, several, a generator or None; its entropy can be JSON."""
    if isinstance(random_seed, np.random.Generator):
        random_seed = random_seed.integers(2**32, size=4)
    try:
        entropy = None if random_seed is None else np.asarray(random_seed).tolist()
        return np.random.SeedSequence(entropy)
    except (TypeError, ValueError) as error:
        raise type(error)(
            f"random_seed is {random_seed!r}; expected a whole number, not negative, several, "
            "or a numpy.random.Generator"
        ) from None


def seed_of(seed: np.random.SeedSequence, label: str) -> np.random.SeedSequence:
    """Return the seed of a label; it does not depend on other labels, or on their order."""
    words = np.frombuffer(hashlib.sha256(label.encode()).digest()[:16], "<u4")
    return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, *words.tolist()))


@without_traces
def particles_to_tree(
    kernel: BatchedSMC,
    populations: list[Array],
    stats: list[list[dict[str, float]]],
    variables: list[TensorVariable],
    random_seed: Any,
) -> xr.DataTree:
    """Return the result of a model from each chain's particles, and statistics of its stages."""
    model = kernel.model
    constrain = BatchedFunction.of_model(model, model.replace_rvs_by_values(variables))
    chains = [constrain(population) for population in populations]
    posterior = {v.name: np.stack([chain[i] for chain in chains]) for i, v in enumerate(variables)}
    unconstrained = kernel.target.by_name(np.stack(populations))
    found = kernel.search.evidence if kernel.search else xr.Dataset()
    if study := study_of(model):
        found = found.merge(study.diagnostics(model, posterior, np.concatenate(populations)))
    return sampling_tree(
        model, posterior, unconstrained, stats, kernel.sample_settings(), random_seed, found
    )
