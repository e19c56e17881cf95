"""Draw the figures of the reference pages: the curves of laws, and the figures of plot functions.

The material of a law and the call of a plot function come from the examples in their docstrings.
"""

import ast
import doctest
import inspect
from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
import pytensor

import pymc_hyperelastic as ph

FOLDER = Path(__file__).resolve().with_name("drawings")
TUBE = ph.Tube(inner_radius=7.0, outer_radius=9.0)  # mm
# The examples of these functions save the fits that the examples of plot functions open.
FITS = ("sample_smc", "fit_classes")


def sources_of(name: str) -> list[str]:
    """Return the statements of the example of a public name."""
    examples = doctest.DocTestParser().get_examples(inspect.getdoc(getattr(ph, name)))
    return [example.source for example in examples]


def example_of(name: str, until: str) -> str:
    """Return the code of the example of a public name, up to the call of a function."""
    sources = sources_of(name)
    last = next(i for i, source in enumerate(sources) if f"ph.{until}(" in source)
    return "".join(sources[: last + 1])


def draw_law(name: str) -> plt.Figure:
    """Draw pressure and axial force against the internal radius at three axial stretches."""
    source, names = example_of(name, "inflation_pressure"), {}
    exec(source, names)
    calls = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call))
    call = next(node for node in calls if getattr(node.func, "attr", "") == "inflation_pressure")
    material = {}
    for keyword in call.keywords:
        value = eval(ast.unparse(keyword.value), names)
        material |= {keyword.arg: value} if keyword.arg else value  # or **value
    radius = np.linspace(7.0, 9.5, 60)
    figure, axes = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
    curves = {"pressure (mmHg)": ph.inflation_pressure, "axial force (N)": ph.axial_force}
    units = {"pressure (mmHg)": ph.mmHg, "axial force (N)": 1e3}
    for ax, (label, curve) in zip(axes, curves.items(), strict=True):
        for stretch in (1.0, 1.2, 1.4):
            tube = replace(TUBE, axial_stretch=stretch)
            values = curve(getattr(ph, name)(), radius, tube, **material).eval()
            ax.plot(radius, values / units[label], label=f"axial stretch {stretch}")
        ax.set(xlabel="internal radius (mm)", ylabel=label)
        if not any(line.get_ydata().any() for line in ax.lines):
            words = "this energy does not\ndetermine the axial force"
            ax.text(0.5, 0.7, words, ha="center", transform=ax.transAxes)
            ax.set_yticks([0])
    axes[0].legend(frameon=False)
    return figure


def draw_plot(name: str) -> plt.Figure:
    """Draw the figure of the example of a plot function."""
    exec(example_of(name, name).replace('backend="none"', 'backend="matplotlib"'), {})
    return plt.gcf()


def draw_all() -> dict[str, list[str]]:
    """Draw the missing figures, and return the names of all laws and plot functions."""
    FOLDER.mkdir(exist_ok=True)
    laws = [name for name in ph.__all__ if name in ph.list_strain_energies()]
    plots = [name for name in ph.__all__ if name.startswith("plot_")]
    missing = [name for name in (*laws, *plots) if not (FOLDER / f"{name}.svg").exists()]
    fast = pytensor.config.change_flags(mode="FAST_COMPILE")  # each curve is computed once
    with TemporaryDirectory() as folder, chdir(folder), fast:
        if set(missing) & set(plots):
            for name in FITS:
                exec("".join(sources_of(name)), {})
        for name in missing:
            figure = draw_law(name) if name in laws else draw_plot(name)
            figure.savefig(FOLDER / f"{name}.svg", metadata={"Date": None})
            plt.close("all")
    return {"laws": laws, "plots": plots}
