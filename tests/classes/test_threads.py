"""A result does not depend on how many threads there are."""

import os
import subprocess
import sys

import pytest

EVIDENCES = """
import pymc_hyperelastic as ph

data = ph.load_dataset("simulated_sheep_aorta")
fitted = ph.fit_classes(
    ph.Ogden(),
    {"C1": ph.select(data, group="C1", experiment=1)},
    sigma=15 * ph.mmHg,
    slope_weight=3.0,
    draws=200,
    chains=2,
    random_seed=1,
    progressbar=False,
)
new = ph.select(data, specimen="S4", experiment=2)
result = ph.classify(new, fitted, random_seed=1, progressbar=False)
for number in (*ph.log_evidence(fitted["C1"]), result["log_evidence"].item()):
    print(number.hex())
"""


@pytest.mark.deep
def test_number_of_threads_does_not_change_a_bit():
    """One thread and two give the same evidences of sampling and of classifying, exactly."""
    printed = []
    for threads in ("1", "2"):
        limits = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), threads)
        run = subprocess.run(
            [sys.executable, "-c", EVIDENCES],
            env=os.environ | limits,
            capture_output=True,
            text=True,
            check=True,
        )
        printed.append(run.stdout.split())
    assert len(printed[0]) == 3
    assert printed[0] == printed[1]
