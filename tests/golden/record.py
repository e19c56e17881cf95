"""Record numbers of the package, and compare later numbers with the recorded ones.

The numbers show whether a change inside the package changed a result. The cases are in `cases.py`.

    python tests/golden/record.py                      record all cases
    python tests/golden/record.py --compare            compare; exit status 1 if any number differs
    python tests/golden/record.py --compare --exact    the same; deterministic numbers bit for bit
    python tests/golden/record.py --only "^layers"     only cases whose name matches this pattern
    python tests/golden/record.py --compare --seed 2   other random numbers: checks the limits

Log densities, gradients and other deterministic numbers are in `densities.json`, sampled numbers
with their standard errors in `samples.json`. The points of a density are stored by the names of its
value variables, on the unconstrained scale, and a new record keeps them; to get new ones, delete
the line of the case.
"""

import argparse
import json
import re
import sys
import time
import warnings
from pathlib import Path

import cases
import numpy as np
import pytensor
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

DENSITIES, SAMPLES = (Path(__file__).with_name(f"{n}.json") for n in ("densities", "samples"))
CASES = {**cases.DENSITIES, **cases.NUMBERS, **cases.SAMPLES}

# Relative limit of deterministic numbers: sums in another order differ by about 1e-12.
RELATIVE = 1e-9
# Absolute limit of deterministic numbers (nats, kPa, kPa/mm, mN, mm): gradients and stresses near 0
# are sums of terms of up to about 1e4 that cancel, which leaves about 1e-11.
ABSOLUTE = 1e-9
# Absolute limit of log evidences by quadrature, nats: the cubature has a relative error of 1e-8.
QUADRATURE = 1e-6
# Limits of sampled numbers: combined standard errors, which one number in 16000 exceeds by chance,
# and units of the number, see `cases.Sampled`.
STANDARD_ERRORS, UNITS = 4.0, 0.1
# The random seed, which can be any number.
SEED = 20260

# Largest distance of each point below the mode of the density, in nats. Near the mode priors and
# normalisers determine the density, and far from it the misfit of the curves does.
DEPTHS = (3.0, 30.0, 1000.0)
# Search of the mode on the unconstrained scale, on which uniform priors have a standard deviation
# of 1.8: number of random starts, their spread, largest distance from the initial point, number of
# iterations, and the misfit (nats) above which its logarithm is minimised.
STARTS, SPREAD, REACH, ITERATIONS, MISFIT = 16, 1.0, 8.0, 60, 1e3


def make_points(model, density):
    """Points about the mode of a density, from a seeded search."""
    rng = np.random.default_rng(SEED)
    first = {name: np.asarray(x, float) for name, x in model.initial_point(SEED).items()}
    ends = np.cumsum([x.size for x in first.values()])[:-1]
    centre = np.concatenate([x.ravel() for x in first.values()])

    def as_point(x):
        parts = zip(np.split(x, ends), first.items(), strict=True)
        return {name: part.reshape(like.shape) for part, (name, like) in parts}

    def objective(x):
        value, *gradient = density(as_point(x))
        value, gradient = -value / MISFIT, np.concatenate([g.ravel() for g in gradient]) / MISFIT
        return np.nan_to_num(np.arcsinh(value), nan=np.inf), -gradient / np.hypot(1, value)

    def depth(x):
        return MISFIT * (np.sinh(objective(x)[0]) - np.sinh(objective(mode)[0]))

    starts = [centre, *(centre + SPREAD * rng.standard_normal((STARTS, centre.size)))]
    mode = min(starts, key=lambda x: objective(x)[0])
    bounds, options = [(x - REACH, x + REACH) for x in centre], {"maxiter": ITERATIONS}
    # A second run forgets the curvature far from the mode.
    for _ in range(2):
        mode = minimize(
            objective, mode, jac=True, method="L-BFGS-B", bounds=bounds, options=options
        ).x
    points = []
    for deepest in DEPTHS:
        step = rng.standard_normal(mode.size)
        while depth(mode + step) > deepest:
            step /= 2
        points.append(as_point(mode + step))
    return points


def density_entry(case, stored):
    """Points of a model with the log density and gradient there."""
    model = cases.DENSITIES[case]()
    logp, variables = model.logp(), model.value_vars
    outputs = [logp, *pytensor.grad(logp, variables)]
    density = model.compile_fn(outputs, inputs=variables, mode=cases.AS_WRITTEN)
    points = stored["points"] if stored else cases.STATED.get(case) or make_points(model, density)
    names, densities = [variable.name for variable in variables], []
    renamed = cases.RENAMED[""] | cases.RENAMED.get(case, {})
    recorded = {new: old for old, (new, _) in renamed.items()} if stored else {}
    names = [recorded.get(name, name) for name in names]
    for point in points:
        now = {renamed.get(name, (name, 0.0)): x for name, x in point.items()}
        value, *gradient = density({n: np.asarray(x, float) + d for (n, d), x in now.items()})
        gradient = dict(zip(names, gradient, strict=True))
        densities.append({"log density": value, "gradient": gradient})
    return {"points": points, "densities": densities}


@np.errstate(all="ignore")
def entry(case, stored=None, seed=SEED):
    """Numbers of a case, computed now, as JSON has them."""
    in_python = pytensor.config.change_flags(mode="FAST_COMPILE", traceback__limit=0)
    with in_python, threadpool_limits(1), warnings.catch_warnings():
        # Warnings have their own tests.
        warnings.simplefilter("ignore")
        if case in cases.DENSITIES:
            found = density_entry(case, stored)
        else:
            found = cases.SAMPLES[case](seed) if case in cases.SAMPLES else cases.NUMBERS[case]()
    return json.loads(json.dumps(found, default=np.ndarray.tolist))


def flat(value, name=""):
    """All numbers of an entry by their path."""
    if not isinstance(value, dict | list):
        return {name: value}
    parts = value.items() if isinstance(value, dict) else enumerate(value)
    return {k: x for key, part in parts for k, x in flat(part, f"{name}/{key}").items()}


def differences(case, old, new, exact=False):
    """Rows (number, recorded, found, limit) of the numbers of a case that differ."""
    if case in cases.SAMPLES:
        limits = {
            name: min(STANDARD_ERRORS * np.hypot(old[name][1], new[name][1]), UNITS * old[name][2])
            for name in old.keys() & new.keys()
        }
        old, new = ({name: x[0] for name, x in entry.items()} for entry in (old, new))
    else:
        old, new = flat(old), flat(new)
        floor = QUADRATURE if case.startswith("quadrature") else ABSOLUTE
        limits = {name: 0.0 if exact else floor + RELATIVE * abs(x) for name, x in old.items()}
    rows = [(name, old.get(name), new.get(name), limits.get(name)) for name in {**old, **new}]
    return [row for row in rows if None in row or not is_close(*row[1:])]


def is_close(old, new, limit):
    """Return True if two numbers are equal or both NaN, or differ by at most the limit."""
    return old == new or abs(old - new) <= limit < np.inf or (np.isnan(old) and np.isnan(new))


def read():
    """All recorded entries by case."""
    files = [json.loads(p.read_text(encoding="utf-8")) for p in (DENSITIES, SAMPLES) if p.exists()]
    return {case: value for file in files for case, value in file.items()}


def write(entries):
    """Write all entries, one line a case."""
    for path, sampled in ((DENSITIES, False), (SAMPLES, True)):
        own = {c: entries[c] for c in CASES if c in entries and (c in cases.SAMPLES) == sampled}
        lines = [f"{json.dumps(case)}: {json.dumps(value)}" for case, value in own.items()]
        path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def main():
    """Command line, see the module."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--compare", action="store_true", help="compare instead of recording")
    parser.add_argument("--exact", action="store_true", help="deterministic numbers bit for bit")
    parser.add_argument("--only", default="", metavar="PATTERN", help="regular expression of names")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the sampled numbers")
    arguments = parser.parse_args()
    recorded, start = read(), time.process_time()
    chosen = [case for case in CASES if re.search(arguments.only, case)]
    found, rows = {}, []
    for case in chosen:
        try:
            found[case] = entry(case, recorded.get(case), arguments.seed)
        except Exception as error:
            rows.append((case, repr(error)))
    print(f"{len(chosen)} cases in {time.process_time() - start:.0f} s of the processor")
    if not arguments.compare:
        write(recorded | found)
        recorded |= found
    rows += [(case, "not recorded") for case in found if case not in recorded]
    known = [case for case in found if case in recorded]
    for case in known:
        different = differences(case, recorded[case], found[case], arguments.exact)
        rows += [(case, *row) for row in different]
    for row in rows:
        print(*(f"{x!s:28}" for x in row))
    same = sum(json.dumps(recorded[case]) == json.dumps(found[case]) for case in known)
    print(f"{len(rows)} numbers differ; {same} of {len(chosen)} cases are the same bit for bit")
    return int(bool(rows))


if __name__ == "__main__":
    sys.exit(main())
