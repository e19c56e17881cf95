"""How long specimens and classes with seven protocols take, by law.

python tests/benchmarks/fibre_speeds.py FourFiber HolzapfelGasserOgden Ogden

Nine simulated tubes of each law are inflated at three axial stretches and extended at four held
pressures, 20 points each, and pressures and axial forces are measured with errors whose size is
known. A class of eight is fitted, and the ninth is classified, both twice: the first time compiles.
Printed are seconds of one core.
"""

import argparse
import time

import numpy as np
import pandas as pd
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.specimens import SpecimenSampler

# Median of each parameter in kPa or without a unit, of about what mouse aortas have.
LAWS = {
    "FourFiber": {
        "c": 13.0,
        "k1_axial": 3.0,
        "k2_axial": 0.05,
        "k1_hoop": 1.0,
        "k2_hoop": 0.1,
        "k1_diagonal": 3.8,
        "k2_diagonal": 0.4,
        "beta": 39.0,
    },
    "HolzapfelGasserOgden": {"c": 15.0, "k1": 5.0, "k2": 0.4, "beta": 39.0},
    "Ogden": {"mu": 20.0, "alpha": 3.0},
}
SPREAD = 0.15  # of logarithms, and of the angle's logit
TUBE = {"inner_radius": 0.45, "outer_radius": 0.57}
STRETCHES, PRESSURES, POINTS = (1.4, 1.5, 1.6), (10.0, 60.0, 100.0, 140.0), 20
ERROR, FORCE_ERROR = 1.0 * ph.mmHg, 0.5


def specimen(law: ph.StrainEnergy, name: str, rng: np.random.Generator) -> pd.DataFrame:
    """The seven tests of a new specimen."""
    material = {k: v * np.exp(SPREAD * rng.standard_normal()) for k, v in LAWS[law.name].items()}
    if "beta" in material:
        material["beta"] = min(material["beta"], 80.0)
    draw = {k: (("chain", "draw"), [[v]]) for k, v in material.items()}
    tree = xr.DataTree.from_dict({"posterior": xr.Dataset(draw)})
    rows = []
    tests = [(np.linspace(10, 140, POINTS), np.full(POINTS, s)) for s in STRETCHES]
    varied = np.linspace(STRETCHES[0], STRETCHES[-1], POINTS)
    tests += [(np.full(POINTS, p), varied) for p in PRESSURES]
    for number, (pressure, stretch) in enumerate(tests, start=1):
        # Points that differ: a held pressure is asked for once for each stretch.
        place = {"energy": law, "axial_stretch": stretch, **TUBE}
        found = ph.tube_properties(tree, pressure * ph.mmHg, check="ignore", **place)
        radius = found["radius"].values.ravel()
        force = ph.axial_force(law, radius, axial_stretch=stretch, **TUBE, **material).eval()
        measured = {
            "radius": radius,
            "stretch": stretch,
            "pressure": pressure * ph.mmHg + ERROR * rng.standard_normal(POINTS),
            "axial_force": force + FORCE_ERROR * rng.standard_normal(POINTS),
        }
        labels = {"specimen": name, "experiment": number, "group": law.name}
        rows.append(pd.DataFrame(labels | measured).dropna())
    return pd.concat(rows)


def timed(words: str, function, *given, **settings):
    """Do it, and print how long it took."""
    start = time.process_time()
    result = function(*given, **settings)
    print(f"  {words:<40}{time.process_time() - start:6.1f} s", flush=True)
    return result


each: list[float] = []  # seconds of the specimens of a class
SAMPLE = SpecimenSampler.__call__


def sample(*given):
    """Sample a specimen, and remember how long it took."""
    start = time.process_time()
    draws = SAMPLE(*given)
    each.append(time.process_time() - start)
    return draws


SpecimenSampler.__call__ = sample
options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
options.add_argument("laws", nargs="+", choices=list(LAWS))
options.add_argument("--seed", type=int, default=1)
args = options.parse_args()
for name in args.laws:
    print(name)
    law, rng = getattr(ph, name)(), np.random.default_rng(args.seed)
    frame = pd.concat(specimen(law, f"S{i}", rng) for i in range(9))
    data = ph.inflation_data(frame, axial_stretch="stretch", check="ignore", **TUBE)
    names = list(dict.fromkeys(data["specimen"].values))
    noise = {"noise_sd": ERROR, "force_noise_sd": FORCE_ERROR, "force_offset_sd": 3.0}
    for words in ("a class of eight, compiled first", "a class of eight"):
        each.clear()
        classes = timed(
            words,
            ph.fit_classes,
            law,
            {"class": ph.select(data, specimen=names[:8])},
            variability="specimen",
            random_seed=1,
            progressbar=False,
            **noise,
        )
    print(f"  of that, a specimen (median){np.median(each):18.1f} s")
    new = ph.select(data, specimen=names[8])
    for words in ("a new specimen, compiled first", "a new specimen"):
        timed(words, ph.classify, new, classes, by="specimen", random_seed=1, progressbar=False)
