"""PyMC models of tubes and sheets whose tests share one set of material parameters."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.select import specimens_of
from pymc_hyperelastic.data.sheets import sheet_tests, tubes_of
from pymc_hyperelastic.evidence.batched import without_traces
from pymc_hyperelastic.evidence.results import attach_study
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import (
    CriscioneType,
    Ogden,
    PowerLawNeoHookean,
    StrainEnergy,
)
from pymc_hyperelastic.models.forward import ForwardModel, Mode, TubeForward, register_curves
from pymc_hyperelastic.models.geometry import (
    complete_unknowns,
    priors_of,
    register_deviations,
    register_measures,
)
from pymc_hyperelastic.models.likelihoods import Likelihood, as_likelihood
from pymc_hyperelastic.models.priors import (
    PRIOR_DRAWS,
    belongs_to,
    draws_of,
    register_priors,
)
from pymc_hyperelastic.models.study import Study, coords_of
from pymc_hyperelastic.parallel import one_thread

# Smallest accepted prior probability of a rising pressure: its estimate errs by 3 %, and with less
# the priors contradict `rising`.
_LEAST_SHARE = 0.05


@one_thread
def material_model(
    energy: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    likelihood: Likelihood | Any,
    *,
    priors: dict[str, Any] | None = None,
    rising: bool = False,
    mode: Mode = "auto",
    name: str = "",
) -> pm.Model:
    r"""PyMC model of tests of tubes, of sheets, or of both, with one set of material parameters.

    The log likelihood is the sum over the tests of both kinds. For sheets with the model's stresses
    ``σ`` under the measured stretches, along the axes ``j`` in which a stress was measured,

    .. math:: σ^{\text{meas}}_{ij} \sim N(σ_j(λ_{x,i}, λ_{y,i}), s_σ^2) .

    The x axis takes the place of the hoop direction of a tube, and the y axis that of its axial
    direction: a strip that was cut along the hoop direction is pulled along x.

    The model holds one random variable for each parameter. For sheets it holds the deterministics
    ``stress_x`` and ``stress_y``, for tubes those of :func:`inflation_model`. Their dimension is
    ``obs``, or ``sheet_obs`` and ``tube_obs`` if the data hold both kinds.

    Parameters
    ----------
    energy : StrainEnergy or list of Layer
        The material; layers only for tubes.
    data : xarray.Dataset
        Tests of :func:`pymc_hyperelastic.inflation_data`, :func:`pymc_hyperelastic.sheet_data`, or
        both, see :func:`pymc_hyperelastic.combine_tests`.
    likelihood : Gaussian, SlopeAugmented, float or distribution
        The measured quantities and their errors, see :class:`~pymc_hyperelastic.Gaussian`: sheets
        need ``stress_sd``, tubes ``pressure_sd``.
    priors, rising, mode, name
        See :func:`inflation_model`. Measures of a tube and `rising` are for tubes.

    Returns
    -------
    pymc.Model
        With the dimensions ``obs`` (points), ``test`` and ``specimen``.

    Raises
    ------
    TypeError
        If the strain energy, the data, the likelihood or a prior is not one.
    ValueError
        See :func:`inflation_model`; and if the likelihood does not state the errors of the kinds of
        tests that the data hold.

    See Also
    --------
    inflation_model, sheet_data, sample_smc

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("treloar_rubber"), experiment="uniaxial")
    >>> model = ph.material_model(ph.Yeoh(), data, ph.Gaussian(stress_sd=50.0))
    >>> [rv.name for rv in model.free_RVs]
    ['c1', 'c2', 'c3']
    """
    context = pm.Model.get_context(error_if_none=False)
    if not isinstance(name, str):
        raise TypeError(f"name is {name!r}; expected a text, such as 'artery'")
    if name and context is None:
        raise ValueError(
            f"name is {name!r}, a prefix in the model of the context, but no model is in context: "
            "make this one inside `with pm.Model():`, or leave the name away"
        )
    settings: dict[str, Any] = {"priors": priors, "rising": rising, "mode": mode, "name": name}
    return build_model(energy, data, as_likelihood(likelihood), parent=context, **settings)


def inflation_model(
    energy: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    likelihood: Likelihood | Any,
    *,
    priors: dict[str, Any] | None = None,
    rising: bool = False,
    mode: Mode = "auto",
    name: str = "",
) -> pm.Model:
    r"""PyMC model of inflation curves: every test shares one set of material parameters.

    It is :func:`material_model` for tests of tubes.

    The model holds one random variable for each parameter, the deterministics ``pressure`` and
    ``stiffness`` (with measured forces also ``axial_force``, with an unknown tube also ``radius``)
    over ``obs``, and the Potential ``likelihood`` or observed variables. Curves are at the measured
    radii, also if these have an error.

    In the context of another model it becomes a part of that model: its variables are registered
    there, under the prefix `name`, and priors may be variables of that model. For the likelihood
    alone use :func:`~pymc_hyperelastic.inflation_likelihood`.

    Parameters
    ----------
    energy : StrainEnergy or list of Layer
        The material, such as ``ph.Ogden()``, or the layers of the wall from the inside out, see
        :class:`~pymc_hyperelastic.Layer`. Variables of a layer carry its number, as in ``mu_1``.
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`.
    likelihood : Gaussian, SlopeAugmented, float or distribution
        The measured quantities and their errors, see :class:`~pymc_hyperelastic.Gaussian` and the
        paper's :class:`~pymc_hyperelastic.SlopeAugmented`. A number or a distribution alone is the
        standard deviation of a pressure, kPa.
    priors : dict of str to distribution or MeasuredValue, optional
        Priors by parameter name, such as ``{"mu": pm.Uniform.dist(0, 50)}``. The default is
        uniform over a documented physical range. A vector parameter has a prior of its size.

        Measures of the tube have no default: without a prior they have the value in the data. They
        are ``inner_radius``, ``axial_stretch``, ``opening_angle`` (rad), and one of
        ``outer_radius``, ``thickness`` (mm) or ``wall_area`` (mm², of the cross-section of the
        unloaded ring). Radii are those of the opened sector, and the angle is the whole one that it
        lacks of a full circle. A distribution is the prior of one value for all tests;
        :class:`~pymc_hyperelastic.MeasuredValue` states the error of the value in the data, for
        each specimen by itself.
    rising : bool, default False
        If True, the prior leaves out materials whose pressure falls somewhere between the smallest
        and the largest radius of a test. The Potential ``rising`` then divides by the prior
        probability of the others, so that the prior is normalised. See also
        :func:`~pymc_hyperelastic.is_admissible`.
    mode : {"auto", "collocation", "quadrature"}
        How the wall is integrated, see :func:`~pymc_hyperelastic.inflation_likelihood`.
    name : str, optional
        Prefix of the names of variables and dimensions in the model of the context, as in
        ``artery::mu``.

    Returns
    -------
    pymc.Model
        With the dimensions ``obs`` (points), ``test`` and ``specimen``. In the context of another
        model it is a part, whose ``root`` is the whole.

    Raises
    ------
    TypeError
        If the strain energy, the data, the likelihood or a prior is not one.
    ValueError
        If the data are unsound, a prior belongs to no parameter and no measure of the tube, a
        parameter has the name of such a measure, or a number is impossible; if the model of the
        context has such names already; or if `rising` is given with variables of that model.

    See Also
    --------
    material_model, population_model, sample_smc

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> likelihood = ph.SlopeAugmented(sigma=5 * ph.mmHg, slope_weight=1.0)
    >>> model = ph.inflation_model(ph.Ogden(), data, likelihood)
    >>> [rv.name for rv in model.free_RVs]
    ['mu', 'alpha']

    Two arteries that share an exponent:

    >>> with pm.Model() as both:
    ...     alpha = pm.Uniform("alpha", 0, 40)
    ...     for group in ("C1", "C2"):
    ...         tests, own = ph.select(data, group=group), {"alpha": alpha}
    ...         part = ph.inflation_model(ph.Ogden(), tests, 4 * ph.mmHg, priors=own, name=group)
    >>> [rv.name for rv in both.free_RVs]
    ['alpha', 'C1::mu', 'C2::mu']
    """
    settings: dict[str, Any] = {"priors": priors, "rising": rising, "mode": mode, "name": name}
    return material_model(energy, data, likelihood, **settings)


@without_traces
def build_model(
    energy: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    likelihood: Likelihood,
    *,
    priors: dict[str, Any] | None = None,
    rising: bool = False,
    mode: Mode = "auto",
    parent: pm.Model | None = None,
    name: str = "",
    forward: ForwardModel | None = None,
) -> pm.Model:
    """Return the model of :func:`inflation_model`, a part of `parent` or by itself.

    The context is ignored. A `forward` model of these data may be given. The data are then a part
    of a cohort, and may lack the tests of tubes, or of sheets, that others of the cohort have.
    """
    wall, distributions, unknown = complete_unknowns(energy, priors, parent)
    likelihood.check(wall, data, distributions, unknown, partial=forward is not None)
    if forward is None:
        # Classes fit one compiled Potential to the data of each; observed variables are not shared.
        settings = {"mode": mode, "replaceable": not likelihood.observed}
        forward = likelihood.forward_model(wall, data, distributions, unknown, **settings)
    elif (tubes := tubes_of(data)) is not None:
        likelihood.check_forces(tubes)
    given = [*distributions.values(), *priors_of(unknown).values()]
    if rising and any(belongs_to(v, parent) for v in given):
        raise ValueError(
            "rising=True divides by the prior probability of the curves that rise, which is not "
            "known where parameters are variables of your own model: give distributions instead"
        )
    model = _empty_model(data, parent, name)
    points, of_specimen = model.name_for("obs"), model.name_for("specimen")
    _, of_test = specimens_of(data)
    if rising and sheet_tests(data).any():
        raise ValueError(
            "rising=True is about the pressures of tubes: leave it away for data with sheets"
        )
    with model:
        parameters = register_priors(distributions)
        of_tube = register_priors(priors_of(unknown))
        deviations = register_deviations(unknown, of_specimen)
        if (tubes := tubes_of(data)) is not None:
            register_measures(tubes, unknown, deviations, of_specimen)
        known = of_tube, {name: z[of_test] for name, z in deviations.items()}
        tube, sizes = forward.with_variables(parameters, *known), likelihood.register_unknowns()
        curves = register_curves(tube, points)
        likelihood.register(tube, curves, sizes, points)
        if isinstance(forward, TubeForward) and rising:
            rises = pt.all(
                forward.between().with_variables(parameters, *known).curves()["stiffness"] > 0
            )
            share = _prior_probability(rises)
            pm.Potential("rising", pt.where(rises, -np.log(share), -np.inf))
    if parent is None:
        study = Study(energy, data, distributions, likelihood, unknown, rising, forward=forward)
        attach_study(model, study)
    return model


def _empty_model(data: xr.Dataset, parent: pm.Model | None, name: str) -> pm.Model:
    """Return a model with the dimensions of the data and no variables."""
    model = pm.Model(name=name, model=parent)
    coords = {model.name_for(dim): values for dim, values in coords_of(data).items()}
    if parent is not None:
        names, there = [*coords, model.name_for("pressure")], {*parent.coords}
        taken = [name for name in names if name in there | parent.root.named_vars.keys()]
        if taken:
            raise ValueError(
                f"the model of the context already has {taken}: give this part of it a name of its "
                "own, name='artery'; or make it outside of the context, if it is a model by itself"
            )
    model.add_coords(coords)
    return model


def power_law_neo_hookean_model(
    data: xr.Dataset, likelihood: Likelihood | Any, **settings: Any
) -> pm.Model:
    """Model of the power-law neo-Hookean tube; see :func:`inflation_model` for the settings.

    See Also
    --------
    inflation_model, PowerLawNeoHookean

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> model = ph.power_law_neo_hookean_model(data, ph.Gaussian(pressure_sd=4 * ph.mmHg))
    """
    return inflation_model(PowerLawNeoHookean(), data, likelihood, **settings)


def ogden_model(data: xr.Dataset, likelihood: Likelihood | Any, **settings: Any) -> pm.Model:
    """Model of the Ogden tube; see :func:`inflation_model` for the settings.

    The posterior is symmetric in ``alpha``: with the default prior it has two mirrored modes.
    For NUTS, which cannot jump between them, give a one-sided prior: the evidence is the same.

    See Also
    --------
    inflation_model, Ogden

    Examples
    --------
    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> model = ph.ogden_model(data, 4 * ph.mmHg, priors={"alpha": pm.Uniform.dist(0, 40)})
    """
    return inflation_model(Ogden(), data, likelihood, **settings)


def criscione_model(data: xr.Dataset, likelihood: Likelihood | Any, **settings: Any) -> pm.Model:
    """Model of the Criscione-type tube; see :func:`inflation_model` for the settings.

    The posterior is symmetric in ``b``; see :func:`ogden_model`.

    See Also
    --------
    inflation_model, CriscioneType

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> model = ph.criscione_model(data, ph.Gaussian(pressure_sd=4 * ph.mmHg))
    """
    return inflation_model(CriscioneType(), data, likelihood, **settings)


def _prior_probability(condition: TensorVariable) -> float:
    """Probability that a condition on random variables holds, from many draws."""
    share = float(np.mean(draws_of([condition], PRIOR_DRAWS)))
    if share < _LEAST_SHARE:
        raise ValueError(
            f"of {PRIOR_DRAWS} draws from the prior {share:.2%} have a pressure that rises with "
            "the radius: give priors that do not contradict it"
        )
    return share
