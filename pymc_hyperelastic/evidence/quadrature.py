"""Evidence by adaptive quadrature: the cross-check of sampling, for one or two parameters."""

from collections.abc import Callable
from itertools import pairwise, product

import numpy as np
import pymc as pm
from scipy.integrate import cubature

from pymc_hyperelastic.evidence.checks import check_model
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture
from pymc_hyperelastic.evidence.unconstrained import log_density_function
from pymc_hyperelastic.parallel import one_thread

# The box ends where the posterior density is below its peak by this many nats.
_NEGLIGIBLE = 35.0
# The box is divided first at these standard deviations from the centres of two components of a
# mixture, so that no narrow mode hides between the nodes of a wide cell.
_DIVISIONS = np.array([-9.0, -5.0, -2.0, 0.0, 2.0, 5.0, 9.0])


@one_thread
def log_evidence_by_quadrature(model: pm.Model, *, rtol: float = 1e-8) -> Estimate:
    r"""Log evidence of a model with one or two parameters by adaptive quadrature.

    .. math:: \ln Z = \ln \int p(y | θ) p(θ) \, dθ

    on the unconstrained scale of the variables. A small run of SMC finds where the posterior lies;
    Gauss-Kronrod cubature of SciPy then integrates over a box around it, at whose faces the density
    is negligible. It is the exact answer to which sampled evidences can be held.

    Parameters
    ----------
    model : pymc.Model
        Any model whose continuous free variables are one or two numbers in total.
    rtol : float
        Relative tolerance of the integral.

    Returns
    -------
    Estimate
        The pair (value, error) in nats; the error is the one that cubature estimates.

    Raises
    ------
    TypeError
        If `model` is no PyMC model.
    ValueError
        If the model has more than two parameters, or the density does not fall off.

    See Also
    --------
    log_evidence

    Examples
    --------
    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> with pm.Model() as model:
    ...     mean = pm.Normal("mean", 0.0, 3.0)
    ...     y = pm.Normal("y", mean, 4.0, observed=1.0)
    >>> round(ph.log_evidence_by_quadrature(model).value, 6)
    -2.548376
    """
    check_model(model)
    kernel = BatchedSMC(draws=1000, model=model)
    if kernel.dimension > 2:
        raise ValueError(
            f"quadrature is for one or two parameters; the model has {kernel.dimension}: "
            "use ph.sample_smc"
        )
    kernel.temper(None, np.random.default_rng(1))
    particles = kernel.tempered_posterior
    log_density = log_density_function(model)
    peak = float(log_density(particles).max())

    def density(points: Array) -> Array:
        return np.exp(log_density(points) - peak)

    mixtures = [GaussianMixture.fit(particles, 2, kernel.rng) for _ in range(10)]
    mixture = max(mixtures, key=lambda fitted: fitted.log_density(particles).mean())
    edges = _divided_box(particles, mixture, density)
    cells = list(product(*(pairwise(axis) for axis in edges)))
    expected = np.exp(kernel.log_marginal_likelihood - peak)
    atol = rtol * expected / len(cells)
    total, error = 0.0, 0.0
    for cell in cells:
        part = cubature(density, *np.transpose(cell), rtol=rtol, atol=atol)
        total += float(part.estimate)
        error += float(part.error)
    return Estimate(float(np.log(total) + peak), error / total)


def _divided_box(
    particles: Array, mixture: GaussianMixture, density: Callable[[Array], Array]
) -> list[Array]:
    """Edges of the cells along each axis; the outermost are where the density is negligible."""
    deviations = np.sqrt((mixture.factors**2).sum(axis=-1))
    inside = mixture.means + _DIVISIONS[:, None, None] * deviations
    inside = inside.reshape(-1, particles.shape[1])
    low, high = inside.min(axis=0), inside.max(axis=0)
    reach = high - low
    along = np.linspace(0.0, 1.0, 5000)[:, None]
    for _ in range(100):
        falls_off = True
        for end, direction in ((low, -1), (high, 1)):
            for axis in range(len(end)):
                # A bent ridge may leave the box far from where the particles are.
                face = np.concatenate([particles, low + (high - low) * along])
                face[:, axis] = end[axis]
                if density(face).max() >= np.exp(-_NEGLIGIBLE):
                    end[axis] += direction * reach[axis]
                    falls_off = False
        if falls_off:
            break
    else:
        raise ValueError("the posterior density does not fall off: is the prior improper?")
    return [np.unique([a, *x, b]) for a, x, b in zip(low, inside.T, high, strict=True)]
