"""PyMC model factories."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from pytensor.graph.replace import vectorize_graph
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import describe_test
from pymc_hyperelastic.data.select import specimens_of
from pymc_hyperelastic.evidence.batched import without_traces
from pymc_hyperelastic.evidence.results import attach_study
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import (
    CriscioneType,
    Ogden,
    PowerLawNeoHookean,
    StrainEnergy,
)
from pymc_hyperelastic.models.forward import ForwardModel, Mode
from pymc_hyperelastic.models.geometry import (
    check_geometry,
    measured_of,
    priors_of,
    register_deviations,
    register_measures,
)
from pymc_hyperelastic.models.observation import Observation
from pymc_hyperelastic.models.observation.observation import ErrorIn, Likelihood
from pymc_hyperelastic.models.priors import belongs_to, complete_wall, register_priors
from pymc_hyperelastic.models.study import Study
from pymc_hyperelastic.parallel import one_thread

# Draws from the prior by which it is known how many of them have a pressure that rises: to 3 % at
# the least share.
_PRIOR_DRAWS, _LEAST_SHARE = 20000, 0.05


@one_thread
def inflation_model(
    energy: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    *,
    noise_sd: Any = None,
    sigma: Any = None,
    slope_weight: Any,
    force_noise_sd: Any = None,
    force_sigma: Any = None,
    force_offset_sd: Any = None,
    diameter_noise_sd: Any = None,
    error_in: ErrorIn = "pressure",
    priors: dict[str, Any] | None = None,
    geometry: dict[str, Any] | None = None,
    rising: bool = False,
    likelihood: Likelihood = "paper",
    mode: Mode = "auto",
    name: str = "",
) -> pm.Model:
    r"""PyMC model of inflation curves: every test shares one set of material parameters.

    The model holds one random variable for each parameter, the deterministics ``pressure`` and
    ``stiffness`` (with measured forces also ``axial_force``, with `geometry` also ``radius``) over
    ``obs``, and the Potential ``likelihood`` (see :func:`~pymc_hyperelastic.inflation_likelihood`)
    or observed variables. Any PyMC sampler takes it.

    Made in the context of another model it is a part of that, as every ``pm.Model`` is: its
    variables are registered there, under the prefix `name`, and the whole is what is sampled. In
    the place of priors there may then be variables of that model, which are registered once. If
    only the likelihood is wanted, use :func:`~pymc_hyperelastic.inflation_likelihood`.

    Parameters
    ----------
    energy : StrainEnergy or list of Layer
        The material, such as ``ph.Ogden()``, or one of your own; or the layers of the wall from the
        inside out, see :class:`~pymc_hyperelastic.Layer`. Random variables of a layer carry its
        number, as in ``mu_1``.
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`.
    noise_sd : float or distribution
        Standard deviation of the errors, kPa. With a distribution, such as
        ``pm.HalfNormal.dist(1)``, it is inferred, as the random variable ``noise_sd``. With slopes
        it is a bound on the standard deviation of a pressure.
    sigma : float or distribution
        In place of `noise_sd` the paper's ``σ``, kPa, which is ``√2`` standard deviations. A
        distribution is one of ``σ``, and ``sigma`` the random variable.
    slope_weight : float or distribution
        The paper's ``β``, mm², likewise; 0 leaves the slopes out. They are those of inflation
        tests: tests in which the axial stretch varies have none.
    force_noise_sd, force_sigma : float or distribution, optional
        The same for measured axial forces, mN; without one of them they play no part.
    force_offset_sd : float or distribution, optional
        Standard deviation, mN, of the offset of the force transducer: what it shows beyond the
        axial force of the tube, one number for all points of a test, another one for the next.
        Each has a normal prior about 0 and is integrated out exactly. See
        :func:`~pymc_hyperelastic.force_offsets` for what is learned of them.
    diameter_noise_sd : float or distribution, optional
        Standard deviation, mm, of the error of a measured outer diameter; where internal radii were
        measured, of twice such a radius. It is an error besides that of the pressure, and slopes
        play no part then. To first order it is a shift along the curves of the model, which
        pressure and force of a point share: see :func:`~pymc_hyperelastic.inflation_likelihood`.
    error_in : {"pressure", "radius"}
        What was measured with an error; with "radius", where curves are steep, `noise_sd` and
        `sigma` are in mm (of the internal radius, or of half an outer diameter) and slopes play no
        part. Forces are then compared with those at the model's radius, where it has the measured
        pressure; the deterministics remain those at the measured radius.
    priors : dict of str to distribution, optional
        Priors by parameter name, such as ``{"mu": pm.Uniform.dist(0, 50)}``. For the others the
        default of the strain energy is taken: uniform over a documented physical range. A vector
        parameter has a prior of its size.
    geometry : dict of str to distribution or Measured, optional
        Priors of what is not known of the tube, one value for all tests: ``inner_radius``,
        ``axial_stretch``, ``opening_angle`` (rad), and one of ``outer_radius``, ``thickness`` (mm)
        or ``wall_area`` (mm², of the cross-section of the unloaded ring). Radii are those of
        the opened sector, and the angle is the whole one that it lacks of a full circle. In place
        of a prior :class:`~pymc_hyperelastic.Measured` says with which error the value in the data
        was measured, of each specimen by itself. The integral is then taken by direct quadrature,
        with gradients through the geometry.
    rising : bool, default False
        Whether the prior leaves out materials whose pressure falls somewhere between the smallest
        and the largest radius of a test. The Potential ``rising`` then divides by the prior
        probability of the others, so that the evidence stays one. What a posterior holds of them
        without it is told by :func:`~pymc_hyperelastic.admissible`.
    likelihood : {"paper", "generative"}
        How the data enter. With "paper" it is the Potential. With "generative" the measured
        pressures ``y`` of each test are the observed variable ``measured_pressure``,

        .. math:: y \sim \mathcal{N}\left(P^{-1} (m + β D^T s),\ \tfrac{σ^2}{2} P^{-1}\right),
            \qquad P = I + β D^T D,

        with the model's pressures ``m`` and slopes ``s`` and the matrix ``D`` of central
        differences. This is the paper's form as a density of the pressures, without its factor for
        the small gap between ``s`` and ``D m``: data can be simulated from it, and it has a
        log-likelihood by points, each given those before it in its test. Forces are
        ``measured_axial_force``, each given those before it where they share an offset, and given
        the pressures where they share the error of a diameter. The values are in the ``pm.Data``
        ``pressure_data`` and ``axial_force_data``. `slope_weight` must be a number, and the error
        in the pressure.
    mode : {"auto", "collocation", "quadrature"}
        How the wall is integrated, see :func:`~pymc_hyperelastic.inflation_likelihood`.
    name : str, optional
        Prefix of the names of variables and dimensions in the model of the context, as in
        ``artery::mu``. With it several tubes can be parts of one model.

    Returns
    -------
    pymc.Model
        With the dimension ``obs`` (points) and ``test`` (experiments). In the context of another
        model it is that part of it; the whole is its ``root``.

    Raises
    ------
    TypeError
        If the strain energy, the data or a prior is not one, or an error is not given, or twice.
    ValueError
        If the data are unsound, a prior belongs to no parameter, or a number is impossible; if the
        model of the context has such names already; or if `rising` is to divide by the prior
        probability of what variables of that model determine.

    See Also
    --------
    population_model, sample_smc

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> model = ph.inflation_model(ph.Ogden(), data, sigma=5 * ph.mmHg, slope_weight=1.0)
    >>> [rv.name for rv in model.free_RVs]
    ['mu', 'alpha']

    A tube whose unloaded inner radius was not measured:

    >>> import pymc as pm
    >>> model = ph.inflation_model(
    ...     ph.Ogden(),
    ...     data,
    ...     sigma=5 * ph.mmHg,
    ...     slope_weight=1.0,
    ...     geometry={"inner_radius": pm.Uniform.dist(6, 8), "thickness": pm.Uniform.dist(1, 3)},
    ... )
    >>> [rv.name for rv in model.free_RVs]
    ['mu', 'alpha', 'inner_radius', 'thickness']

    Forces by a transducer whose zero is not known:

    >>> import numpy as np
    >>> forces = data.assign(axial_force=("obs", np.full(data.sizes["obs"], 50.0)))
    >>> noise = {"noise_sd": pm.HalfNormal.dist(1), "force_noise_sd": pm.HalfNormal.dist(10)}
    >>> model = ph.inflation_model(
    ...     ph.Ogden(), forces, **noise, force_offset_sd=100.0, slope_weight=0.0
    ... )
    >>> [rv.name for rv in model.free_RVs]
    ['mu', 'alpha', 'noise_sd', 'force_noise_sd']
    >>> [v.name for v in model.deterministics if "offset" in v.name]
    ['force_offset_mean', 'force_offset_error']

    Measurements as an observed variable:

    >>> model = ph.inflation_model(
    ...     ph.Ogden(), data, sigma=5 * ph.mmHg, slope_weight=1.0, likelihood="generative"
    ... )
    >>> [rv.name for rv in model.observed_RVs]
    ['measured_pressure']

    Two arteries in a model of one's own, of one exponent:

    >>> noise = {"noise_sd": 4 * ph.mmHg, "slope_weight": 0}
    >>> with pm.Model() as both:
    ...     alpha = pm.Uniform("alpha", 0, 40)
    ...     for group in ("C1", "C2"):
    ...         tests, own = ph.select(data, group=group), {"alpha": alpha}
    ...         part = ph.inflation_model(ph.Ogden(), tests, **noise, priors=own, name=group)
    >>> [rv.name for rv in both.free_RVs]
    ['alpha', 'C1::mu', 'C2::mu']
    """
    context = pm.Model.get_context(error_if_none=False)
    if name and context is None:
        raise ValueError(
            f"name is {name!r}, a prefix in the model of the context, but no model is in context: "
            "make this one inside `with pm.Model():`, or leave the name away"
        )
    noise = {"noise_sd": noise_sd, "force_noise_sd": force_noise_sd}
    noise |= {"force_offset_sd": force_offset_sd, "diameter_noise_sd": diameter_noise_sd}
    observation = Observation(sigma, slope_weight, force_sigma, error_in, likelihood, **noise)
    unknown: dict[str, Any] = {"priors": priors, "geometry": geometry, "rising": rising}
    return tube_model(energy, data, observation, **unknown, mode=mode, parent=context, name=name)


@without_traces
def tube_model(
    energy: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    observation: Observation,
    *,
    priors: dict[str, Any] | None = None,
    geometry: dict[str, Any] | None = None,
    rising: bool = False,
    mode: Mode = "auto",
    parent: pm.Model | None = None,
    name: str = "",
    forward: ForwardModel | None = None,
) -> pm.Model:
    """Model of :func:`inflation_model`, a part of `parent` or by itself, whatever the context.

    The `forward` model of these data may be known already.
    """
    wall, distributions = complete_wall(energy, priors, parent)
    unknown = check_geometry(geometry, parent)
    observation.check(wall, data, distributions, unknown)
    # Classes fit one compiled Potential to the data of each; observed variables are not shared.
    settings = {"mode": mode, "replaceable": observation.likelihood == "paper"}
    if forward is None:
        forward = observation.forward_model(wall, data, distributions, unknown, **settings)
    if rising and any(
        belongs_to(v, parent) for v in [*distributions.values(), *priors_of(unknown).values()]
    ):
        raise ValueError(
            "rising=True divides by the prior probability of the curves that rise, which is not "
            "known where parameters are variables of your own model: give distributions instead"
        )
    model = pm.Model(name=name, model=parent)
    points = model.name_for("obs")
    coords = {
        points: np.arange(data.sizes["obs"]),
        model.name_for("test"): [describe_test(data, test) for test in range(data.sizes["test"])],
    }
    specimens, of_test = specimens_of(data)
    measured = measured_of(unknown)
    of_specimen = model.name_for("specimen")
    if measured:
        coords[of_specimen] = specimens
    if parent is not None:
        _check_names(parent, [*coords, model.name_for("pressure")])
    model.add_coords(coords)
    with model:
        parameters = register_priors(distributions)
        of_tube = register_priors(priors_of(unknown))
        deviations = register_deviations(measured, of_specimen)
        register_measures(data, measured, deviations, of_specimen)
        known = of_tube, {name: z[of_test] for name, z in deviations.items()}
        tube, observed = forward.tube(parameters, *known), observation.with_variables()
        curves = {
            curve: pm.Deterministic(curve, values, dims=points)
            for curve, values in tube.curves().items()
        }
        observed.register(tube, curves, dims=points)
        if rising:
            rises = pt.all(forward.between().tube(parameters, *known).curves()["stiffness"] > 0)
            share = _prior_probability(rises, model.free_RVs)
            pm.Potential("rising", pt.where(rises, -np.log(share), -np.inf))
    if parent is None:
        study = Study(energy, data, distributions, observation, unknown, rising, forward=forward)
        attach_study(model, study)
    return model


def _check_names(model: pm.Model, names: Sequence[str]) -> None:
    """Raise unless a model has no variables or dimensions of these names."""
    taken = [name for name in names if name in model.coords or name in model.root.named_vars]
    if taken:
        raise ValueError(
            f"the model of the context already has {taken}: give this part of it a name of its "
            "own, name='artery'; or make it outside of the context, if it is a model by itself"
        )


@one_thread
def power_law_neo_hookean_model(data: xr.Dataset, **settings: Any) -> pm.Model:
    """Model of the power-law neo-Hookean tube; see :func:`inflation_model` for the settings.

    See Also
    --------
    inflation_model, PowerLawNeoHookean

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> model = ph.power_law_neo_hookean_model(data, sigma=5 * ph.mmHg, slope_weight=1.0)
    """
    return inflation_model(PowerLawNeoHookean(), data, **settings)


@one_thread
def ogden_model(data: xr.Dataset, **settings: Any) -> pm.Model:
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
    >>> model = ph.ogden_model(
    ...     data, sigma=5 * ph.mmHg, slope_weight=1.0, priors={"alpha": pm.Uniform.dist(0, 40)}
    ... )
    """
    return inflation_model(Ogden(), data, **settings)


@one_thread
def criscione_model(data: xr.Dataset, **settings: Any) -> pm.Model:
    """Model of the Criscione-type tube; see :func:`inflation_model` for the settings.

    The posterior is symmetric in ``b``; see :func:`ogden_model`.

    See Also
    --------
    inflation_model, CriscioneType

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> model = ph.criscione_model(data, sigma=5 * ph.mmHg, slope_weight=1.0)
    """
    return inflation_model(CriscioneType(), data, **settings)


def _prior_probability(condition: TensorVariable, variables: Sequence[TensorVariable]) -> float:
    """Probability that a condition on random variables holds, from many draws."""
    draws = pm.draw(variables, draws=_PRIOR_DRAWS, random_seed=1, mode="FAST_COMPILE")
    symbols = {v: pt.tensor(dtype=v.dtype, shape=(None, *v.type.shape)) for v in variables}
    holds = vectorize_graph(condition, symbols)
    function = pytensor.function(list(symbols.values()), holds, mode="FAST_COMPILE")
    with np.errstate(all="ignore"):
        share = float(np.mean(function(*draws)))
    if share < _LEAST_SHARE:
        raise ValueError(
            f"of {_PRIOR_DRAWS} draws from the prior {share:.2%} have a pressure that rises with "
            "the radius: give priors that do not contradict it"
        )
    return share
