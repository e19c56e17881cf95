"""Compute the posterior of the offset of the force transducer in each test."""

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import describe_test
from pymc_hyperelastic.evidence.results import check_result
from pymc_hyperelastic.evidence.stored import read_numbers
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.likelihoods import OFFSET_VARIABLES
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.members import SEED
from pymc_hyperelastic.quantities import QUANTITIES

# Dimension of tests of tubes in results that hold tests of sheets, too.
_TUBE_TEST = "tube_test"


@one_thread
def force_offsets(tree: xr.DataTree) -> xr.Dataset:
    r"""Compute the posterior of the offset of the force transducer in each test.

    Offsets are integrated out of the likelihood of a model with ``force_offset_sd``. Given
    material, tube and noise, the offset ``o`` of a test is normal. For ``n`` measured forces
    ``f_i``, forces ``F_i`` of the model, and standard deviations ``s`` of the offset and ``s_F`` of
    a force,

    .. math:: o \sim \mathcal{N}\left(\frac{v}{s_F^2} \sum_i (f_i - F_i),\ v\right), \qquad
        \frac1v = \frac1{s^2} + \frac{n}{s_F^2} .

    The model stores the mean and ``√v`` as the deterministics ``force_offset_mean`` and
    ``force_offset_error``. This function draws one offset from this distribution for each draw of
    the posterior. If the diameter has an error, the inverse of each force's conditional variance
    given its pressure replaces ``1/s_F²``.

    Parameters
    ----------
    tree : xarray.DataTree
        Result of a model with ``force_offset_sd``, such as that of
        :func:`pymc_hyperelastic.sample_smc`, or a class of :func:`pymc_hyperelastic.fit_classes`.

    Returns
    -------
    xarray.Dataset
        ``force_offset`` (mN) with dimensions (chain, draw, test): reading of the transducer minus
        axial force of the tube. Tests without a measured force have the prior of the offset. Every
        call returns the same draws.

    Raises
    ------
    TypeError
        If `tree` is no DataTree.
    ValueError
        If the model has no offsets.

    See Also
    --------
    predict_axial_force

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> of_test = ("chain", "draw", "test")
    >>> moments = {"force_offset_mean": 3.0, "force_offset_error": 0.1}
    >>> posterior = xr.Dataset({k: (of_test, [[[v]] * 400]) for k, v in moments.items()})
    >>> offsets = ph.force_offsets(xr.DataTree.from_dict({"posterior": posterior}))
    >>> round(offsets["force_offset"].mean().item(), 1)
    3.0
    """
    check_result(tree)
    if not knows_offsets(tree):
        raise ValueError(
            "the result has no offsets of the force transducer: sample a model that has them, "
            "ph.Gaussian(..., force_sd=..., force_offset_sd=...), and keep the "
            f"variables {list(OFFSET_VARIABLES)} in its posterior"
        )
    mean, error = (_by_test(tree, name) for name in OFFSET_VARIABLES)
    offset = mean + error * np.random.default_rng(SEED).standard_normal(mean.shape)
    offset.attrs = QUANTITIES["force_offset"].attributes
    return offset.to_dataset(name="force_offset")


def _by_test(tree: xr.DataTree, name: str) -> xr.DataArray:
    """Return a variable of the offsets with the dimension ``test``, which are tests of tubes."""
    joint = _TUBE_TEST in tree["posterior"][name].dims
    test = _TUBE_TEST if joint else "test"
    found = read_numbers(tree, "posterior", name, ("chain", "draw", test))
    return found.rename({test: "test"}) if joint else found


def knows_offsets(tree: xr.DataTree) -> bool:
    """Return True if the posterior has the offset of each test."""
    posterior = tree.children.get("posterior", {})
    return all(name in posterior for name in OFFSET_VARIABLES)


def less_offsets(data: xr.Dataset, tree: xr.DataTree) -> xr.Dataset:
    """Subtract the posterior mean of each test's offset from its forces.

    Data are returned unchanged if the result has no offsets. Forces of tests to which the result
    was not fitted stay unchanged, with a warning.
    """
    if "axial_force" not in data or not knows_offsets(tree):
        return data
    mean = _by_test(tree, OFFSET_VARIABLES[0]).mean(["chain", "draw"])
    offsets = dict(zip(mean["test"].values.tolist(), mean.values.tolist(), strict=True))
    tests = [describe_test(data, i) for i in range(data.sizes["test"])]
    test, force = data["test"].values, data["axial_force"]
    with_forces = [tests[i] for i in sorted(set(test[force.notnull().values].tolist()))]
    unknown = [name for name in with_forces if name not in offsets]
    if unknown:
        others = f" and {len(unknown) - 1} more" if len(unknown) > 1 else ""
        warn_user(
            f"{unknown[0]}{others}: the result was not fitted to these tests, and has no offset of "
            "their force transducer; their forces are shown as measured"
        )
    offset = np.array([offsets.get(name, 0.0) for name in tests])[test]
    return data.assign(axial_force=force.copy(data=force.values - offset))
