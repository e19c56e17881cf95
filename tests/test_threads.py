"""Functions return the same results in several threads as one after another."""

from concurrent.futures import ThreadPoolExecutor

import fits
import matplotlib

import pymc_hyperelastic as ph


def evidence(specimen):
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen=specimen, experiment=1)
    model = ph.inflation_model(ph.NeoHookean(), data, 5.0)
    return ph.log_evidence(ph.sample_smc(model, 100, 1, random_seed=1, progressbar=False))


def properties(specimen):
    tree = fits.fit("sampled")
    return float(ph.tube_properties(tree, 10.0 + int(specimen[1]))["radius"].mean())


def test_fits_and_predictions_in_threads_equal_those_one_by_one():
    specimens = ["S1", "S2", "S3", "S4"]
    for function in (evidence, properties):
        alone = [function(specimen) for specimen in specimens]
        with ThreadPoolExecutor(4) as pool:
            assert list(pool.map(function, specimens * 2)) == alone * 2


def test_reports_in_two_threads_leave_the_settings_of_figures(tmp_path):
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    before = dict(matplotlib.rcParams)
    paths = [tmp_path / f"{i}.html" for i in range(2)]
    with ThreadPoolExecutor(2) as pool:
        pages = list(pool.map(lambda path: ph.report(data, path).read_text("utf-8"), paths))
    assert dict(matplotlib.rcParams) == before
    assert set(pages) == {pages[0]} and "data:image" in pages[0]
