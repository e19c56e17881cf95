"""Functions return the same results in several threads as one after another."""

from concurrent.futures import ThreadPoolExecutor

import fits
import matplotlib
import numpy as np
import pymc as pm
from threadpoolctl import threadpool_limits

import pymc_hyperelastic as ph


def evidence(specimen):
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen=specimen, experiment=1)
    model = ph.inflation_model(ph.NeoHookean(), data, 5.0)
    return ph.log_evidence(ph.sample_smc(model, 100, 1, random_seed=1, progressbar=False))


def properties(specimen):
    tree = fits.fit("sampled")
    return float(ph.tube_properties(tree, 10.0 + int(specimen[1]))["radius"].mean())


def decision(specimen):
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen=specimen, experiment=3)
    found = ph.classify(data, fits.fit("pooled"), random_seed=1, progressbar=False)
    return found["log_evidence"].values.tolist()


def test_fits_decisions_and_predictions_in_threads_equal_serial_calls():
    four = ["S1", "S2", "S3", "S4"]
    for function, specimens in ((evidence, four), (decision, four[:2]), (properties, four)):
        alone = [function(specimen) for specimen in specimens]
        with ThreadPoolExecutor(4) as pool:
            assert list(pool.map(function, specimens * 2)) == alone * 2


def test_likelihoods_made_in_threads_equal_likelihoods_made_serially():
    """Each thread adds its likelihood to its own model, which is evaluated afterwards."""

    def made(specimen):
        data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen=specimen)
        with pm.Model() as model:
            known = {"mu": pm.Uniform("mu", 0.0, 50.0), "alpha": pm.Uniform("alpha", 1.0, 20.0)}
            ph.inflation_likelihood("curves", ph.Ogden(), data, 0.5, known)
        return model

    def value(model):
        return float(model.compile_logp(mode="FAST_COMPILE")(model.initial_point(random_seed=1)))

    specimens = ["S1", "S2", "S3", "S4"]
    alone = [value(made(specimen)) for specimen in specimens]
    with ThreadPoolExecutor(4) as pool:
        models = list(pool.map(made, specimens))
    assert [value(model) for model in models] == alone


def test_reports_in_two_threads_are_equal_and_keep_matplotlib_settings(tmp_path):
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    before = dict(matplotlib.rcParams)
    paths = [tmp_path / f"{i}.html" for i in range(2)]
    with ThreadPoolExecutor(2) as pool:
        pages = list(pool.map(lambda path: ph.report(data, path).read_text("utf-8"), paths))
    assert dict(matplotlib.rcParams) == before
    assert set(pages) == {pages[0]} and "data:image" in pages[0]


def test_numbers_do_not_depend_on_the_threads_of_the_linear_algebra():
    """Curves of many draws are products of matrices that BLAS divides between threads."""
    found = []
    for threads in (1, 2):
        with threadpool_limits(threads, user_api="blas"):
            model = ph.inflation_model(ph.Ogden(), ph.load_dataset("simulated_sheep_aorta"), 5.0)
            sampled = ph.sample_smc(model, 500, 1, random_seed=1, progressbar=False)
            found.append(sampled["posterior"]["pressure"].values)
    np.testing.assert_array_equal(*found)
