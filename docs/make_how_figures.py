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


def response(log_hoop, material):
    """Return T in kPa, at the axial stretch 1."""
    law = ph.Ogden()
    return law.stress_difference(log_hoop, np.zeros_like(log_hoop), **material).eval()


def draw_integral(ax, radius, material) -> None:
    """Draw the integrand of one pressure, with the nodes of its quadrature."""
    for order, style in ((200, "C0-"), (WALL_ORDER, "C0o")):
        rule, place = wall_at(radius, order)
        delta = (radius**2 - TUBE.inner_radius**2) / place**2
        stress = response(rule.log_hoop, material)
        ax.plot(place, stress / (1 + delta), style, markersize=3)
    ax.fill_between(place, stress / (1 + delta), color="C0", alpha=0.2)
    pressure = float(rule.pressure_weight @ stress) / ph.mmHg
    ax.text(8, 18, f"area = pressure = {pressure:.0f} mmHg", ha="center")
    ax.set_xscale("log")
    ax.set_xticks([7, 7.5, 8, 8.5, 9], [7, 7.5, 8, 8.5, 9])
    ax.minorticks_off()
    ax.set(
        title=f"Pointwise: {WALL_ORDER} nodes for each point",
        xlabel="reference radius R in the wall (mm)",
        ylabel="T / (1 + δ)   (kPa)",
        ylim=(0, None),
    )


def draw_nodes(ax, data, integrator, material) -> None:
    """Draw the response at the nodes of all points, and the walls of some points."""
    measured = data["pressure"].values / ph.mmHg
    tubes, (group,) = integrator.groups(data)
    nodes = integrator.basis.interpolation(tubes, group).places[0]
    stretch = np.linspace(nodes.min(), nodes.max(), 200)
    ax.plot(np.exp(stretch), response(stretch, material), "C1-")
    ax.plot(np.exp(nodes), response(nodes, material), "C1o", markersize=4)
    for i, point in enumerate(SHOWN):
        low = -30 * (i + 1)
        ends = np.exp([face[point] for face in tubes.log_hoop])
        ax.plot(ends, 2 * [low], "C0-", lw=4, solid_capstyle="butt")
        at, side = (ends.max() + 0.005, "left") if i < 2 else (ends.min() - 0.005, "right")
        words = f"wall at {measured[point]:.0f} mmHg"
        ax.text(at, low, words, va="center", ha=side, color="C0")
    ax.set_yticks([0, 100, 200])
    ax.set(
        title=f"Tabulated: {len(nodes)} nodes for all {len(measured)} points",
        xlabel="hoop stretch λθ",
        ylabel="response T (kPa)",
    )


def draw_curve(ax, data, material) -> None:
    """Draw the curve of the material and the measured points."""
    radius, measured = data["radius"].values, data["pressure"].values / ph.mmHg
    dense = np.linspace(radius.min(), radius.max(), 60)
    pressure = ph.inflation_pressure(ph.Ogden(), dense, TUBE, **material).eval()
    ax.plot(dense, pressure / ph.mmHg, "k-")
    ax.plot(radius, measured, "k.")
    ax.plot(radius[list(SHOWN)], measured[list(SHOWN)], "C0o")
    ax.set(
        title="Both give this curve",
        xlabel="internal radius a (mm)",
        ylabel="pressure (mmHg)",
    )


def draw_pressure(data, priors, material) -> None:
    """Draw the wall integral, and the nodes of both integrators."""
    forward = ForwardModel(ph.Ogden(), data, priors)
    (error,) = forward.errors(data, {name: np.array([x]) for name, x in material.items()})
    print(f"the integrators differ by {error:.0e} of the largest pressure")
    figure, (integral, nodes, curve) = panels(2.6, 2.9, 2.3)
    draw_integral(integral, data["radius"].values[SHOWN[1]], material)
    draw_nodes(nodes, data, forward.integrator, material)
    draw_curve(curve, data, material)
    save(figure, "how_pressure")


def natural(points):
    """Return mu and alpha of points on the unconstrained scale."""
    return [a + (b - a) * expit(x) for x, (a, b) in zip(points.T, PRIOR.values(), strict=True)]


def show(ax, points, *style, **settings) -> None:
    """Draw points on the unconstrained scale."""
    mu, alpha = natural(points)
    ax.plot(alpha, mu, *style, **settings)


def draw_search(ax, target, prior):
    """Find the modes, and draw them with the starting points."""
    starts = [*starting_points(prior, np.add(*target.score(prior)))][:2]
    modes = find_modes(target.derivatives, starts, width_of(prior)).mixture
    show(ax, prior, ".", color="0.6", ms=3, label="draws of the prior")
    show(ax, np.concatenate(starts), "C0x", label="starting points")
    show(ax, modes.means, "C3*", ms=11, label="modes")
    ax.set(title="1  Search: optimise from far starting points")
    return modes


def draw_weights(ax, target, modes, rng):
    """Draw fresh draws of the proposal, larger if they have more weight; return the evidence."""
    proposal = modes.heavy_tailed()
    points, log_weights = weighted_draws(target.score, proposal, 8000, rng, target.draw_prior)
    evidence, _ = mean_weight(log_weights)
    shown = rng.choice(len(points), PARTICLES, replace=False)
    mu, alpha = natural(points[shown])
    size = 12 * np.exp(log_weights[shown] - log_weights.max())
    ax.scatter(alpha, mu, s=np.maximum(size, 1.5), color="C0", lw=0)
    ax.set(title="2  Importance sampling: weigh fresh draws")
    return evidence


def draw_stages(ax, target, prior, rng):
    """Temper particles from the prior, draw three of the stages, and return the evidence."""
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
        show(ax, particles, ".", color=color, ms=3, label=f"β = {beta:.2g}")
    ax.set(title=f"3  SMC: from prior to posterior in {smc.stages} stages")
    return ph.Estimate(smc.log_evidence, np.sqrt(smc.variance))


def draw_estimates(ax, model, rows) -> None:
    """Draw evidences by their names, that of `sample_smc`, and the exact one."""
    tree = ph.sample_smc(model, draws=PARTICLES, random_seed=SEED, progressbar=False)
    rows = rows | {"sample_smc": ph.log_evidence(tree)}
    for row, (value, error) in enumerate(rows.values()):
        ax.errorbar(value, row, xerr=2 * error, fmt="ko", capsize=3)
    ax.axvline(float(ph.log_evidence_by_quadrature(model)), color="C3", lw=1)
    ax.set_yticks(range(3), list(rows))
    ax.set(
        ylim=(2.6, -0.6),
        xlabel="log evidence (nats); line: exact value",
        title=f'4  Evidence ± 2 errors: "{tree["diagnosis"].attrs["verdict"]}"',
    )
    ax.locator_params(axis="x", nbins=4)


def draw_evidence(model):
    """Draw the three steps and their results; return the material of the mode with α > 0."""
    rng, target = np.random.default_rng(SEED), Target(model)
    prior = target.draw_prior(PARTICLES, rng)
    figure, axes = panels(2.5, 2.2, 2.5, 1.7)
    modes = draw_search(axes[0], target, prior)
    rows = {"step 2": draw_weights(axes[1], target, modes, rng)}
    rows["step 3"] = draw_stages(axes[2], target, prior, rng)
    draw_estimates(axes[3], model, rows)
    for ax in axes[:3]:
        ax.set(xlim=PRIOR["alpha"], ylim=PRIOR["mu"], xlabel="α", ylabel="μ (kPa)")
    for ax in (axes[0], axes[2]):
        below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.26), "ncols": 3}
        ax.legend(**below, handlelength=0.8, columnspacing=1.2, frameon=False)
    save(figure, "how_evidence")
    mu, alpha = natural(modes.means)
    return {"mu": float(mu[0]), "alpha": float(abs(alpha[0]))}


if __name__ == "__main__":
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=1)
    priors = {name: pm.Uniform.dist(*ends) for name, ends in PRIOR.items()}
    likelihood = ph.Gaussian(5 * ph.mmHg)
    material = draw_evidence(ph.inflation_model(ph.Ogden(), data, likelihood, priors=priors))
    draw_pressure(data, priors, material)
