"""A result can be saved, read, plotted by ArviZ, and says from what it was made."""

import json

import arviz as az
import numpy as np
import pymc as pm
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.results import sampling_tree
from pymc_hyperelastic.models.study import inflation_data_of, model_settings_of

# One expression twice; only the order of sums may differ.
SAME_DENSITY = 1e-12
# Enough for every group to have its shape; nothing here depends on how good the sample is.
DRAWS, CHAINS = 60, 2
SEED = 20260101


@pytest.fixture(scope="module")
def data() -> xr.Dataset:
    return ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen=["S1", "S4"], experiment=1)


@pytest.fixture(scope="module")
def model(data) -> pm.Model:
    """A model in which everything that can be inferred is, under priors of several kinds."""
    return ph.ogden_model(
        data,
        sigma=pm.HalfNormal.dist(2),
        slope_weight=1.0,
        priors={"mu": pm.Gamma.dist(2, 3)},
    )


def sample(model: pm.Model, **settings) -> xr.DataTree:
    settings = {"random_seed": SEED, **settings}
    return ph.sample_smc(model, DRAWS, CHAINS, progressbar=False, **settings)


@pytest.fixture(scope="module")
def tree(model) -> xr.DataTree:
    return sample(model)


def plain_model() -> pm.Model:
    """A model that has nothing to do with tubes."""
    with pm.Model() as plain:
        x = pm.Normal("x")
        pm.Potential("likelihood", -(x**2))
    return plain


def test_groups_and_dims(tree, data):
    """A result has ArviZ's groups, and each array the documented dimensions."""
    assert set(tree.children) == {
        "posterior",
        "unconstrained_posterior",
        "sample_stats",
        "evidence",
        "diagnosis",
        "observed_data",
        "constant_data",
    }
    sizes = {"chain": CHAINS, "draw": DRAWS}
    posterior = tree["posterior"]
    assert set(posterior.data_vars) == {"mu", "alpha", "sigma", "pressure", "stiffness"}
    for name in ("mu", "alpha", "sigma"):
        assert dict(posterior[name].sizes) == sizes
    for name in ("pressure", "stiffness"):
        assert dict(posterior[name].sizes) == sizes | {"obs": data.sizes["obs"]}
    particles = tree["unconstrained_posterior"]
    assert set(particles.data_vars) == {"mu_log__", "alpha_interval__", "sigma_log__"}
    for values in particles.data_vars.values():
        assert dict(values.sizes) == sizes
    for name, values in tree["sample_stats"].data_vars.items():
        assert values.dims == ("chain", "stage"), name
    for name in ("log_evidence", "log_evidence_se"):
        assert dict(tree["evidence"][name].sizes) == {"chain": CHAINS}
    assert dict(tree["observed_data"]["pressure"].sizes) == {"obs": data.sizes["obs"]}
    assert tree["constant_data"]["inner_radius"].dims == ("test",)


def test_every_stage_reaches_the_posterior(tree):
    """In each chain the tempering power rises to one, and after that there is nothing but NaN."""
    for chain in tree["sample_stats"]["beta"].values:
        stages = chain[np.isfinite(chain)]
        assert np.all(np.diff(stages) > 0)
        assert stages[-1] == 1
        assert np.isnan(chain[stages.size :]).all()


def test_stages_are_padded():
    """Chains of different length share one rectangle, and the evidence is of the last stage."""
    names = ("beta", "log_marginal_likelihood", "log_evidence_variance")
    short, long = ({name: list(stages) for name in names} for stages in ([1.0], [0.25, 0.5, 1.0]))
    result = sampling_tree(plain_model(), {"x": np.zeros((2, 3))}, {}, [short, long], {}, 1)
    np.testing.assert_array_equal(
        result["sample_stats"]["beta"], [[1.0, np.nan, np.nan], [0.25, 0.5, 1.0]]
    )
    np.testing.assert_array_equal(result["evidence"]["log_evidence"], [1.0, 1.0])


def test_data_come_back(tree, data):
    """The data of a result are the data that went in."""
    xr.testing.assert_identical(inflation_data_of(tree), data)


def test_attributes_suffice_to_rebuild_the_model(tree, model):
    """From a result alone comes a model whose density is that of the model that was sampled."""
    again = ph.inflation_model(data=inflation_data_of(tree), **model_settings_of(tree))
    assert [rv.name for rv in again.free_RVs] == [rv.name for rv in model.free_RVs]
    assert again.study.attrs() == model.study.attrs()
    densities = [m.compile_logp(mode="FAST_COMPILE") for m in (model, again)]
    particles = tree["unconstrained_posterior"].to_dataset()
    for draw in range(0, DRAWS, 20):
        point = {name: x.values[0, draw] for name, x in particles.data_vars.items()}
        expected, found = (float(density(point)) for density in densities)
        assert np.isfinite(expected)
        assert found == pytest.approx(expected, rel=SAME_DENSITY)


def test_units_and_versions_are_stored(tree):
    """A file says what its numbers are measured in, and what made it."""
    units = {"sigma": "kPa", "slope_weight": "mm2", "mu": "kPa", "alpha": ""}
    assert json.loads(tree.attrs["units"]) == units
    assert json.loads(tree.attrs["versions"])["pymc"] == pm.__version__
    assert tree["constant_data"]["radius"].attrs["units"] == "mm"


def test_netcdf_round_trip(tree, tmp_path):
    """A saved result comes back identical, with its evidence and its settings."""
    tree.to_netcdf(tmp_path / "result.nc", engine="h5netcdf")
    loaded = xr.load_datatree(tmp_path / "result.nc", engine="h5netcdf")
    xr.testing.assert_identical(loaded, tree)
    assert ph.log_evidence(loaded) == ph.log_evidence(tree)
    assert list(model_settings_of(loaded)) == list(model_settings_of(tree))


@pytest.mark.filterwarnings("ignore:the evidence is doubtful")  # whatever the seed
@pytest.mark.parametrize("seed", [None, np.int64(3), (1, 2)], ids=repr)
def test_the_stored_seed_gives_the_result_again(seed):
    """Whatever the seed was, and also if none was given, the result says how to have it again."""
    first = sample(plain_model(), random_seed=seed)
    again = sample(plain_model(), random_seed=json.loads(first.attrs["random_seed"]))
    xr.testing.assert_equal(first, again)


def test_a_model_of_anything_else_has_a_result():
    """Sampling works for other models; their results do not claim to be of inflation data."""
    result = sample(plain_model())
    assert set(result.children) == {
        "posterior",
        "unconstrained_posterior",
        "sample_stats",
        "evidence",
        "diagnosis",
    }
    with pytest.raises(ValueError, match=r"does not say from which model"):
        model_settings_of(result)


def test_a_prior_of_ones_own_is_no_obstacle_to_a_result(data):
    """With a prior that cannot be stored the result names its material, but not the settings."""
    mixture = pm.Mixture.dist([0.5, 0.5], [pm.Normal.dist(-8, 1), pm.Normal.dist(8, 1)])
    model = ph.ogden_model(data, sigma=1.0, slope_weight=0, priors={"alpha": mixture})
    names = ("beta", "log_marginal_likelihood", "log_evidence_variance")
    posterior = {"mu": np.ones((1, 3)), "alpha": np.ones((1, 3))}
    result = sampling_tree(model, posterior, {}, [{name: [1.0] for name in names}], {}, 1)
    assert result.attrs["strain_energy"] == "Ogden"
    xr.testing.assert_identical(inflation_data_of(result), data)
    with pytest.raises(ValueError, match=r"does not say from which model"):
        model_settings_of(result)


def test_arviz_summary(tree):
    """ArviZ summarises every parameter, and every point by its label."""
    summary = az.summary(tree, var_names=["mu", "alpha", "sigma"])
    assert list(summary.index) == ["mu", "alpha", "sigma"]
    assert "pressure[39]" in az.summary(tree, var_names=["pressure"]).index


@pytest.mark.parametrize("plot", ["plot_trace_dist", "plot_dist", "plot_forest", "plot_rank"])
def test_arviz_plots(tree, plot):
    """The plots of ArviZ take a result as it is and show each parameter that is asked for."""
    drawn = getattr(az, plot)(tree, var_names=["mu", "alpha"], backend="none")
    visuals = [set(visual.data_vars) for visual in drawn.viz.children.values()]
    assert any({"mu", "alpha"} <= names for names in visuals)


def test_arviz_pair_plot(tree):
    """The joint posterior can be drawn by ArviZ."""
    assert az.plot_pair(tree, var_names=["mu", "alpha"], backend="none") is not None


# --- vector parameters ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def series_classes() -> xr.DataTree:
    """Two classes of a law with vectors, fitted with few draws."""
    sheep = ph.load_dataset("simulated_sheep_aorta")
    return ph.fit_classes(
        ph.OgdenSeries(terms=2),
        {name: ph.select(sheep, group=name, experiment=1) for name in ("C1", "C2")},
        sigma=3.0,
        slope_weight=0,
        priors={"alpha": pm.Uniform.dist([1, 5], [10, 20])},
        draws=DRAWS,
        chains=1,
        random_seed=SEED,
        progressbar=False,
    )


def test_vectors_are_stored_and_come_back(series_classes, tmp_path):
    """Law, number of terms, and priors of all entries survive a file, and so does what follows."""
    series_classes.to_netcdf(tmp_path / "classes.nc", engine="h5netcdf")
    loaded = xr.load_datatree(tmp_path / "classes.nc", engine="h5netcdf")
    xr.testing.assert_identical(loaded, series_classes)
    for name in ("mu", "alpha"):
        values = loaded["C1"]["posterior"][name]
        assert values.shape == (1, DRAWS, 2)
    low, high = np.array([1, 5]), np.array([10, 20])
    alpha = loaded["C1"]["posterior"]["alpha"].values
    assert np.all((low < alpha) & (alpha < high))  # entry by entry, in their order

    attrs = loaded["C1"].attrs
    assert attrs["strain_energy"] == "OgdenSeries"
    assert json.loads(attrs["strain_energy_settings"]) == {"terms": 2}
    settings = model_settings_of(loaded["C1"])
    assert settings["energy"] == ph.OgdenSeries(terms=2)
    again = ph.inflation_model(data=inflation_data_of(loaded["C1"]), **settings)
    assert {rv.name: rv.type.shape for rv in again.free_RVs} == {"mu": (2,), "alpha": (2,)}
    stored = json.loads(attrs["priors"])
    assert stored == json.loads(again.study.attrs()["priors"])
    assert stored["mu"] == ["Uniform", [[0.0], [100.0]], 2]
    assert stored["alpha"] == ["Uniform", [[1.0, 5.0], [10.0, 20.0]], 2]

    new = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S4", experiment=3)
    results = [
        ph.classify(new, classes, random_seed=1, progressbar=False)
        for classes in (series_classes, loaded)
    ]
    xr.testing.assert_identical(*results)
    assert results[0]["class_probability"].idxmax("class_label").item() == "C2"
