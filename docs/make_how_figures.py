"""Make ``_static/how_pressure.png`` and ``_static/how_evidence.png``, on a SIMULATED aorta.

Run it as ``python docs/make_how_figures.py``; it takes about a minute.
"""

from io import BytesIO
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pymc as pm
from PIL import Image
from scipy.special import expit

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.importance import mean_weight, weighted_draws
from pymc_hyperelastic.evidence.modes import find_modes, starting_points
from pymc_hyperelastic.evidence.path import GeometricPath
from pymc_hyperelastic.evidence.target import Target, width_of
from pymc_hyperelastic.evidence.tempering import TemperedSMC
from pymc_hyperelastic.mechanics.wall import WALL_ORDER, wall_rule
from pymc_hyperelastic.models.forward import ForwardModel

FOLDER = Path(__file__).parent / "_static"
# Inches and pixels per inch. A telephone of 400 pixels shows the figure at about this width, so
# that its letters have their true size there; on a desk it is shown half as large again.
WIDTH, DPI = 4.2, 230
STYLE = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.fontsize": 8,
}
TUBE = ph.Tube(inner_radius=7.0, outer_radius=9.0)  # mm, that of the simulated aortas
PRIOR = {"mu": (0.0, 60.0), "alpha": (-20.0, 20.0)}  # of Ogden's law: kPa, and without a unit
SHOWN = (0, 9, 19)  # points of the test whose walls the figure shows
PARTICLES = 1000
SEED = 3


def panels(*heights):
    """Return a figure and its panels, one below the other."""
    plt.style.use(["default", STYLE])
    size = (WIDTH, sum(heights))
    return plt.subplots(len(heights), figsize=size, height_ratios=heights, layout="constrained")


def save(figure, name: str) -> None:
    """Write a figure, on white, so that it can be read on a dark page too."""
    file = BytesIO()
    figure.savefig(file, dpi=DPI, facecolor="white")
    plt.close(figure)
    image = Image.open(file).convert("RGB").quantize(128)  # few colours make a small file
    image.save(FOLDER / f"{name}.png", optimize=True)


def wall_at(radius: float, order: int):
    """Return the quadrature rule of the wall at an internal radius, and the nodes R in mm."""
    ends = TUBE.inner_radius, TUBE.outer_radius
    geometry = [np.array([value]) for value in (radius, *ends, 1.0, 0.0)]
    place = (np.polynomial.legendre.leggauss(order)[0] + 1) / 2
    return wall_rule(np, geometry, order=order), ends[0] * (ends[1] / ends[0]) ** place


def draw_pressure(data, material) -> None:
    """Draw the wall integral, and the nodes of both integrators."""

    def response(log_hoop):
        """T in kPa."""
        law = ph.Ogden()
        return law.stress_difference(log_hoop, np.zeros_like(log_hoop), **material).eval()

    radius, measured = data["radius"].values, data["pressure"].values / ph.mmHg
    figure, (integral, table, curve) = panels(2.6, 2.9, 2.3)
    for order, style in ((200, "C0-"), (WALL_ORDER, "C0o")):
        rule, place = wall_at(radius[SHOWN[1]], order)
        delta = (radius[SHOWN[1]] ** 2 - TUBE.inner_radius**2) / place**2
        values = response(rule.log_hoop) / (1 + delta)
        integral.plot(place, values, style, markersize=3)
    integral.fill_between(place, values, color="C0", alpha=0.2)
    pressure = float(rule.pressure_weight @ response(rule.log_hoop)) / ph.mmHg
    integral.text(8, values.min() / 2, f"area = pressure = {pressure:.0f} mmHg", ha="center")
    integral.set_xscale("log")
    integral.set_xticks([7, 7.5, 8, 8.5, 9], [7, 7.5, 8, 8.5, 9])
    integral.minorticks_off()
    integral.set(
        title=f"Pointwise: {WALL_ORDER} nodes for each point",
        xlabel="reference radius R in the wall (mm)",
        ylabel="T / (1 + δ)   (kPa)",
        ylim=(0, None),
    )

    priors = {name: pm.Uniform.dist(*ends) for name, ends in PRIOR.items()}
    forward = ForwardModel(ph.Ogden(), data, priors)
    integrator = forward.integrator
    tubes, (group,) = integrator.groups(data)
    nodes = integrator.basis.interpolation(tubes, group).places[0]
    stretch = np.linspace(nodes.min(), nodes.max(), 200)
    table.plot(np.exp(stretch), response(stretch), "C1-")
    table.plot(np.exp(nodes), response(nodes), "C1o", markersize=4)
    low = -0.12 * response(nodes).max()
    for i, point in enumerate(SHOWN):
        ends = np.exp([face[point] for face in tubes.log_hoop])
        table.plot(ends, 2 * [low * (i + 1)], "C0-", lw=4, solid_capstyle="butt")
        at, side = (ends.max() + 0.005, "left") if i < 2 else (ends.min() - 0.005, "right")
        words = f"wall at {measured[point]:.0f} mmHg"
        table.text(at, low * (i + 1), words, va="center", ha=side, color="C0")
    table.set_yticks([0, 100, 200])
    table.set(
        title=f"Tabulated: {len(nodes)} nodes for all {len(radius)} points",
        xlabel="hoop stretch λθ",
        ylabel="response T (kPa)",
    )

    (error,) = forward.errors(data, {name: np.array([x]) for name, x in material.items()})
    print(f"the integrators differ by {error:.0e} of the largest pressure")
    dense = np.linspace(radius.min(), radius.max(), 60)
    pressure = ph.inflation_pressure(ph.Ogden(), dense, TUBE, **material).eval()
    curve.plot(dense, pressure / ph.mmHg, "k-")
    curve.plot(radius, measured, "k.")
    curve.plot(radius[list(SHOWN)], measured[list(SHOWN)], "C0o")
    curve.set(
        title="Both give this curve",
        xlabel="internal radius a (mm)",
        ylabel="pressure (mmHg)",
    )
    save(figure, "how_pressure")


def natural(points):
    """Return mu and alpha of points on the unconstrained scale."""
    return [a + (b - a) * expit(x) for x, (a, b) in zip(points.T, PRIOR.values(), strict=True)]


def draw_evidence(model):
    """Draw search, importance sampling, tempering and the estimates; return the best material."""
    rng = np.random.default_rng(SEED)
    target = Target(model)
    prior = target.draw_prior(PARTICLES, rng)
    starts = [*starting_points(prior, np.add(*target.score(prior)))]
    modes = find_modes(target.derivatives, starts[:2], width_of(prior))
    figure, (search, importance, tempering, estimates) = panels(2.2, 2.2, 2.2, 1.7)

    mu, alpha = natural(prior)
    search.plot(alpha, mu, ".", color="0.6", ms=3, label="draws of the prior")
    mu, alpha = natural(np.concatenate(starts[:2]))
    search.plot(alpha, mu, "C0x", label="starting points")
    mu, alpha = natural(modes.mixture.means)
    search.plot(alpha, mu, "C3*", ms=11, label="modes")
    search.set(title="1  Search: optimise from far starting points")
    best = {"mu": float(mu[0]), "alpha": float(abs(alpha[0]))}

    points, log_weights = weighted_draws(
        target.score, modes.mixture.heavy_tailed(), 8000, rng, target.draw_prior
    )
    by_draws, pareto_k = mean_weight(log_weights)
    shown = rng.choice(len(points), PARTICLES, replace=False)
    mu, alpha = natural(points[shown])
    size = 12 * np.exp(log_weights[shown] - log_weights.max())
    importance.scatter(alpha, mu, s=np.maximum(size, 1.5), color="C0", lw=0)
    importance.set(title="2  Importance sampling: weigh fresh draws")
    print(f"Pareto shape {pareto_k:.2f}")

    smc = TemperedSMC(GeometricPath(target), prior, rng)
    stages = [(0.0, smc.particles)]
    while smc.beta < 1:
        smc.reweight()
        smc.resample()
        smc.adapt()
        smc.move()
        stages.append((smc.beta, smc.particles))
    for color, stage in zip(("0.6", "C1", "C3"), (0, len(stages) // 2, -1), strict=True):
        beta, particles = stages[stage]
        mu, alpha = natural(particles)
        tempering.plot(alpha, mu, ".", color=color, ms=3, label=f"β = {beta:.2g}")
    tempering.set(title=f"3  SMC: from prior to posterior in {smc.stages} stages")
    for ax in (search, importance, tempering):
        ax.set(xlim=PRIOR["alpha"], ylim=PRIOR["mu"], xlabel="α", ylabel="μ (kPa)")
    for ax in (search, tempering):
        ax.legend(loc="lower center", handlelength=0.8, borderpad=0.3, framealpha=0.9)

    exact = ph.log_evidence_by_quadrature(model)
    tree = ph.sample_smc(model, draws=PARTICLES, random_seed=SEED, progressbar=False)
    rows = {
        "step 2": by_draws,
        "step 3": ph.Estimate(smc.log_evidence, np.sqrt(smc.variance)),
        "sample_smc": ph.log_evidence(tree),
    }
    for row, (value, error) in enumerate(rows.values()):
        estimates.errorbar(value, row, xerr=2 * error, fmt="ko", capsize=3)
    estimates.axvline(float(exact), color="C3", lw=1)
    estimates.set_yticks(range(3), list(rows))
    estimates.set(
        ylim=(2.6, -0.6),
        xlabel="log evidence (nats); line: exact value",
        title=f'4  Evidence ± 2 errors: "{tree["diagnosis"].attrs["verdict"]}"',
    )
    estimates.locator_params(axis="x", nbins=4)
    save(figure, "how_evidence")
    return best


if __name__ == "__main__":
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=1)
    priors = {name: pm.Uniform.dist(*ends) for name, ends in PRIOR.items()}
    model = ph.inflation_model(ph.Ogden(), data, ph.Gaussian(5 * ph.mmHg), priors=priors)
    material = draw_evidence(model)
    print(material)
    draw_pressure(data, material)
