"""Configuration of the documentation; build it with ``make docs``."""

from importlib.metadata import version as installed_version

import matplotlib

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

# Gallery: the two studies are run, the other scripts are shown.
sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"(sheep_aorta|pulmonary)",
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
