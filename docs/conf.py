"""Configuration of the documentation; build it with ``make docs``."""

from importlib.metadata import version as installed_version
from pathlib import Path

import matplotlib

import pymc_hyperelastic as ph

matplotlib.use("Agg")

project = "pymc_hyperelastic"
author = "The pymc_hyperelastic developers"
project_copyright = author
version = release = installed_version("pymc-hyperelastic")

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
templates_path = ["_templates"]
exclude_patterns = ["_build", "gallery/*.ipynb"]  # the gallery offers notebooks for download

# Pages: Markdown, and notebooks written as Markdown, which every full build runs.
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # seconds a cell
nb_merge_streams = True

# Reference: one page for each public name, holding what the class itself defines.
autosummary_generate = True
autodoc_inherit_docstrings = False
autodoc_typehints = "none"  # numpydoc's parameter lists already say it
numpydoc_show_class_members = False

# Gallery: the two studies are run, the other scripts are shown. What several of them import is no
# example by itself, and lies beside them for download.
imported_by_examples = r"(murine_tables|outer_diameter)\.py$"
sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"(sheep_aorta|pulmonary)",
    "ignore_pattern": imported_by_examples,
    "copyfile_regex": imported_by_examples,
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_signature": False,
}

html_theme = "pydata_sphinx_theme"
html_title = project
html_show_sourcelink = False
html_theme_options = {
    "navigation_with_keys": False,
    "primary_sidebar_end": [],
    "show_toc_level": 2,
}

# The zoo: a page written from the laws themselves, so that a new one appears on it by itself.
ZOO = """# The zoo of strain energies

These laws come with the package. Each name in the first table leads to the law's equation and
source. All of them give pressure, stiffness, axial force, models, evidence and classification. How
their stresses are computed is part of the [theory](theory/laws.md). A law that is not
here takes [ten lines](guides/own_law.md).

```{{eval-rst}}
.. currentmodule:: pymc_hyperelastic

.. autosummary::
   :toctree: generated
   :nosignatures:

{names}
```

## Parameters

The default prior of each parameter is uniform over a fixed range, which
[never depends on the data](theory/priors.md).

| strain energy | symbol | name | unit | default prior | meaning |
|---|---|---|---|---|---|
{rows}
"""


def write_zoo() -> None:
    every_law = map(ph.StrainEnergy.from_name, ph.list_strain_energies())
    laws = sorted(
        (law for law in every_law if type(law).__module__.startswith(ph.__name__)),
        key=lambda law: law.name,
    )
    rows = []
    for law in laws:
        cell = f"{{class}}`~pymc_hyperelastic.{law.name}`"
        for p in law.parameters:
            ends = " to ".join(f"{round(end, 3):g}".replace("-", "−") for end in p.prior_range)
            name = f"`{p.name}`" + (", a vector" if p.size else "")
            rows.append(f"| {cell} | ${p.symbol}$ | {name} | {p.unit} | {ends} | {p.description} |")
            cell = ""
    names = "\n".join(f"   {law.name}" for law in laws)
    page = ZOO.format(names=names, rows="\n".join(rows))
    Path(__file__).with_name("strain_energies.md").write_text(page, encoding="utf-8")


write_zoo()


def name_public_bases(app, name, obj, options, bases) -> None:
    """Name base classes as users import them, not by the module in which they stand."""
    bases[:] = [
        f":py:class:`~pymc_hyperelastic.{base.__name__}`" if base.__name__ in ph.__all__ else base
        for base in bases
    ]


def setup(app) -> None:
    app.connect("autodoc-process-bases", name_public_bases)
