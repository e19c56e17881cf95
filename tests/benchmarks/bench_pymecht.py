"""Agreement with pymecht and time against it, for tubes that both packages can inflate.

``python bench_pymecht.py`` is a script for an environment of its own that has both packages,
``pip install pymc-hyperelastic pymecht pyDOE==0.9.5``: pymecht pulls in a deep-learning library, so
it is no extra of this package. Every law of both is inflated to 20 radii. The script prints the
largest relative difference in pressure and in reduced axial force and the time of one curve by each
package, and fails where they differ by more than `TOLERANCE`.

pymecht has no axial force; it has the stresses through the wall, which are integrated here. The
package reaches the same force by a formula that needs no pressure. ``--values`` prints the digits
that `tests/published.py` stores.
"""

import argparse
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from math import pi, radians
from typing import Any

import numpy as np
import pytensor
import pytensor.tensor as pt

import pymc_hyperelastic as ph

# pymecht leaves the tolerances of scipy.integrate.quad as they are: 1.5e-8, absolute and relative.
# Its 21 nodes are exact to rounding for these walls, and no interval has to be divided.
TOLERANCE = 1e-9
# So many of ours do for these walls: the differences that are printed tell.
ORDER = 8
POINTS = 20
# Stresses at 2^6 + 1 places through a layer, extrapolated to none between them.
HALVINGS = 6
# Times are the least of several: other processes only ever add to one.
REPEATS = 5


@dataclass(frozen=True)
class Layer:
    """One layer in the words of both packages."""

    energy: ph.StrainEnergy
    parameters: Mapping[str, float]
    thickness: float
    models: tuple[str, ...]
    """Names of pymecht's energies, which add up."""
    model_parameters: Mapping[str, float]
    fibres: Mapping[int, float] = field(default_factory=dict)
    """Angle in degrees from the circumferential direction, by the model that has the fibres."""


@dataclass(frozen=True)
class Case:
    """A tube, inflated from one internal radius to another."""

    layers: tuple[Layer, ...]
    inner_radius: float
    axial_stretch: float
    opening_angle: float
    """Degrees."""
    radii: tuple[float, float]

    @property
    def geometry(self) -> dict[str, float]:
        """Geometry as the package takes it."""
        return {
            "inner_radius": self.inner_radius,
            "axial_stretch": self.axial_stretch,
            "opening_angle": radians(self.opening_angle),
        }


def aorta(layer: Layer) -> Case:
    """A sheep's aorta: its geometry, an axial stretch and an opening angle."""
    return Case((layer,), 7.0, 1.2, 60.0, (7.0, 9.0))


def carotid_layer(thickness: float, c: float, k1: float, k2: float, beta: float) -> Layer:
    """A layer of the carotid artery, fibres in a neo-Hookean matrix."""
    return Layer(
        ph.HolzapfelGasserOgden(),
        {"c": c, "k1": k1, "k2": k2, "beta": beta},
        thickness,
        ("nh", "hgo"),
        {"mu_0": c, "k3_1": k1, "k4_1": k2},
        {1: beta},
    )


# Fibres in the four anisotropic laws are stretched everywhere: pymecht lets them bear compression.
CASES = {
    "NeoHookean": aorta(
        Layer(ph.NeoHookean(), {"mu": 20.0}, 2.0, ("nh",), {"mu_0": 20.0}),
    ),
    "MooneyRivlin": aorta(
        Layer(
            ph.MooneyRivlin(),
            {"c10": 8.0, "c01": 2.0},
            2.0,
            ("mr",),
            {"c1_0": 8.0, "c2_0": 2.0},
        ),
    ),
    "Yeoh": aorta(
        Layer(
            ph.Yeoh(),
            {"c1": 10.0, "c2": 5.0, "c3": 2.0},
            2.0,
            ("yeoh",),
            {"c1_0": 10.0, "c2_0": 5.0, "c3_0": 2.0, "c4_0": 0.0},
        ),
    ),
    "Gent": aorta(
        Layer(
            ph.Gent(),
            {"mu": 20.0, "limit": 2.3},
            2.0,
            ("Gent",),
            {"mu_0": 20.0, "Jm_0": 2.3},
        ),
    ),
    "Demiray": aorta(
        Layer(
            ph.Demiray(),
            {"mu": 20.0, "b": 2.0},
            2.0,
            ("expI1",),
            {"k1_0": 10.0, "k2_0": 2.0},
        ),
    ),
    "HolzapfelGasserOgden": aorta(
        Layer(
            ph.HolzapfelGasserOgden(),
            {"c": 10.0, "k1": 20.0, "k2": 1.5, "beta": 40.0},
            2.0,
            ("nh", "hgo"),
            {"mu_0": 10.0, "k3_1": 20.0, "k4_1": 1.5},
            {1: 40.0},
        ),
    ),
    "GasserOgdenHolzapfel": aorta(
        Layer(
            ph.GasserOgdenHolzapfel(),
            {"c": 10.0, "k1": 20.0, "k2": 1.5, "kappa": 0.1, "beta": 40.0},
            2.0,
            ("nh", "goh"),
            {"mu_0": 10.0, "k1_1": 20.0, "k2_1": 1.5, "k3_1": 0.1},
            {1: 40.0},
        ),
    ),
    "FourFiber": aorta(
        Layer(
            ph.FourFiber(),
            {
                "c": 10.0,
                "k1_axial": 15.0,
                "k2_axial": 0.5,
                "k1_hoop": 12.0,
                "k2_hoop": 0.8,
                "k1_diagonal": 6.0,
                "k2_diagonal": 1.2,
                "beta": 40.0,
            },
            2.0,
            ("nh", "hgo", "hgo", "hgo"),
            {
                "mu_0": 10.0,
                "k3_1": 15.0,
                "k4_1": 0.5,
                "k3_2": 12.0,
                "k4_2": 0.8,
                "k3_3": 6.0,
                "k4_3": 1.2,
            },
            {1: 90.0, 2: 0.0, 3: 40.0},
        ),
    ),
    "carotid artery, two layers": Case(
        (
            carotid_layer(0.26, 3.0, 2.3632, 0.8393, 29.0),
            carotid_layer(0.13, 0.3, 0.5620, 0.7112, 62.0),
        ),
        inner_radius=1.43,
        axial_stretch=1.7,
        opening_angle=160.0,
        radii=(0.8, 1.3),
    ),
}


class Pymecht:
    """The tube in pymecht."""

    def __init__(self, case: Case) -> None:
        import pymecht

        self.case = case
        self.samples, self.values, inner = [], [], case.inner_radius
        for layer in case.layers:
            material = pymecht.MatModel(*layer.models)
            for n, angle in layer.fibres.items():
                material.models[n].fiber_dirs = directions(angle)
            self.samples.append(pymecht.TubeInflation(material))
            tube = {
                "Ri": inner,
                "thick": layer.thickness,
                "omega": radians(case.opening_angle),
                "lambdaZ": case.axial_stretch,
                "L0": 1.0,
            }
            self.values.append({**tube, **layer.model_parameters})
            inner += layer.thickness
        self.layered = pymecht.LayeredTube(*self.samples) if len(self.samples) > 1 else None

    def pressure(self, radii: np.ndarray) -> np.ndarray:
        """Pressure at the internal radii."""
        if self.layered is None:
            return self.samples[0].disp_controlled(radii, self.values[0])
        named = {
            f"{name}_layer{i}": value
            for i, values in enumerate(self.values)
            for name, value in values.items()
        }
        return self.layered.disp_controlled(radii, named)

    def force(self, radius: float) -> float:
        """Reduced axial force, from the axial stresses that pymecht gives through each layer."""
        left = self.pressure(np.array([radius]))[0]
        total, inside = -pi * radius**2 * left, radius
        for sample, values in zip(self.samples, self.values, strict=True):
            places, stresses = sample.cauchy_stress(inside, values, 2**HALVINGS + 1, pressure=left)
            reference = values["Ri"] + np.array(places) * values["thick"]
            k = 2 * pi / (2 * pi - values["omega"])
            # r dr = R dR/(k l_z)
            weight = 2 * pi * reference * values["thick"] / (k * values["lambdaZ"])
            total += romberg(weight * np.array([stress[2, 2] for stress in stresses]))
            left = left - sample.disp_controlled(inside, values)
            inside = float(sample.outer_radius(inside, values))
        return total


def directions(angle: float) -> list[np.ndarray]:
    """Two families at plus and minus the angle, or one along an axis; radial, hoop, axial."""
    hoop, axial = np.cos(radians(angle)), np.sin(radians(angle))
    if angle in (0.0, 90.0):
        return [np.array([0.0, float(angle == 0.0), float(angle == 90.0)])]
    return [np.array([0.0, hoop, axial]), np.array([0.0, hoop, -axial])]


def romberg(values: np.ndarray) -> float:
    """Integral over [0, 1] of a smooth function known at 2^n + 1 even places."""
    step, column = 1.0 / (len(values) - 1), []
    for n in range(HALVINGS + 1):
        coarse = values[:: 2 ** (HALVINGS - n)]
        width = step * 2 ** (HALVINGS - n)
        row = [width * (coarse.sum() - (coarse[0] + coarse[-1]) / 2)]
        for j, before in enumerate(column):
            row.append(row[j] + (row[j] - before) / (4 ** (j + 1) - 1))
        column = row
    return float(column[-1])


def compiled(function: Callable[..., Any], case: Case) -> tuple[Any, list[np.ndarray]]:
    """A compiled function of the radii and all parameters, and those parameters.

    The inputs are arrays of the right type, so that the function need not convert them: it is told
    so, as PyMC tells its own compiled functions.
    """
    radii, values, layers = pt.dvector(), [], []
    inputs: list[Any] = []
    for layer in case.layers:
        own = {name: pt.dscalar(name) for name in layer.parameters}
        inputs += own.values()
        values += layer.parameters.values()
        layers.append(ph.Layer(layer.energy, layer.thickness, **own))
    output = function(layers, radii, order=ORDER, **case.geometry)
    repeated = pytensor.function([radii, *inputs], output)
    repeated.trust_input = True
    return repeated, [np.asarray(value, dtype=float) for value in values]


def least_time(call: Callable[[], Any], seconds: float) -> float:
    """Time of one call: the least mean of some rounds, each of about the given length."""
    call()
    start = time.perf_counter()
    call()
    calls = max(1, round(seconds / (time.perf_counter() - start)))
    rounds = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        for _ in range(calls):
            call()
        rounds.append((time.perf_counter() - start) / calls)
    return min(rounds)


def largest_difference(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Relative to the largest value of the curve: force and pressure may pass through zero."""
    return float(np.max(np.abs(ours - theirs)) / np.max(np.abs(theirs)))


def main() -> None:
    """Compare all cases; exit with an error where the packages disagree."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--values", action="store_true", help="print pymecht's digits")
    show_values = parser.parse_args().values
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    for package in ("pymc-hyperelastic", "pytensor", "pymecht", "numpy", "scipy"):
        print(package, version(package), end="; ")
    print(f"{POINTS} points, one core\n")
    print(f"{'':27} {'pressure':>9} {'force':>9} {'theirs':>10} {'ours':>10} {'ratio':>8}")
    worst, ratios = 0.0, []
    for name, case in CASES.items():
        radii = np.linspace(*case.radii, POINTS)
        theirs = Pymecht(case)
        pressure, values = compiled(ph.inflation_pressure, case)
        force, _ = compiled(ph.axial_force, case)
        their_pressure = theirs.pressure(radii)
        their_force = np.array([theirs.force(float(radius)) for radius in radii])
        differences = [
            largest_difference(pressure(radii, *values), their_pressure),
            largest_difference(force(radii, *values), their_force),
        ]
        their_time = least_time(lambda: theirs.pressure(radii), 0.2)
        our_time = least_time(lambda: pressure(radii, *values), 0.05)
        ratios.append(their_time / our_time)
        worst = max(worst, *differences)
        print(
            f"{name:27} {differences[0]:9.1e} {differences[1]:9.1e} {their_time * 1e3:7.1f} ms "
            f"{our_time * 1e6:7.1f} µs {ratios[-1]:8.0f}"
        )
        if show_values:
            for radius in (case.radii[0], sum(case.radii) / 2, case.radii[1]):
                stored = theirs.pressure(np.array([radius]))[0], theirs.force(radius)
                print(f"    ({radius}, {stored[0]:.15g}, {stored[1]:.15g}),")
    print(f"\nlargest difference {worst:.1e}; ratios {min(ratios):.0f} to {max(ratios):.0f}")
    if worst > TOLERANCE:
        raise SystemExit(f"the packages differ by {worst:.1e}, more than {TOLERANCE}")


if __name__ == "__main__":
    main()
