"""Configuration of the documentation; build it with ``make docs``."""

import os
import re
import sys
import tomllib
from importlib.metadata import version as installed_version
from pathlib import Path

import matplotlib
import nbformat
from docutils import nodes
from myst_nb.core.read import read_myst_markdown_notebook

import pymc_hyperelastic as ph

sys.path.insert(0, str(Path(__file__).parent))
from drawings import draw_all

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

# Pages are Markdown files. Some are notebooks in Markdown; every full build runs them.
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # seconds a cell
nb_merge_streams = True
# Figures of notebooks are SVG: sharp on every screen.
os.environ["IPYTHONDIR"] = str(Path(__file__).with_name("_build") / "ipython")
profile = Path(os.environ["IPYTHONDIR"]) / "profile_default"
profile.mkdir(parents=True, exist_ok=True)
figures = 'c.InlineBackend.figure_formats = {"svg"}\n'
(profile / "ipython_kernel_config.py").write_text(figures, encoding="utf-8")

# Reference: one page for each public name, with the members that the class itself defines.
autosummary_generate = True
autosummary_context = draw_all()
autodoc_inherit_docstrings = False
autodoc_typehints = "none"  # numpydoc's parameter lists already say it
numpydoc_show_class_members = False
# Names in types of parameters link to their pages. links.toml lists the addresses for other
# packages, so that a build needs no network.
LINKS = tomllib.loads(Path(__file__).with_name("links.toml").read_text(encoding="utf-8"))
# Alternative texts and captions of the stored figures.
STORED_ALT = tomllib.loads(
    Path(__file__).with_name("stored_figures.toml").read_text(encoding="utf-8")
)
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"  # but these
numpydoc_xref_aliases = {name: f":py:obj:`{name}`" for name in LINKS} | {
    name: f":py:obj:`~pymc_hyperelastic.{name}`" for name in ph.__all__
}

# The copy button does not copy prompts.
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

# Gallery: the build runs the examples that take a minute. Pages of longer examples show their
# stored output. A module that several examples import is not an example, but can be downloaded.
imported_by_examples = r"murine_tables\.py$"
sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"(sheep_aorta|pulmonary|classify_csv|rubber|skin|inflation_and_strip)",
    "ignore_pattern": imported_by_examples,
    "copyfile_regex": rf"{imported_by_examples}|curves\.csv$",
    "image_srcset": ["2x"],  # sharp on dense screens too
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_signature": False,
    "write_computation_times": False,
    "parallel": 2,  # examples at a time
}

# Formulas: a script of this site converts their LaTeX to MathML in the browser.
mathjax_path = "math.js"
myst_update_mathjax = False
scripts = ("temml/temml.min.js", "names.js", "figures.js")
html_js_files = [(script, {"defer": "defer"}) for script in scripts]

html_theme = "pydata_sphinx_theme"
html_title = project
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_favicon = "_static/favicon.svg"
html_show_sourcelink = False
html_last_updated_fmt = "%Y-%m-%d"
# These pages have no sections, and so no side bar.
html_sidebars = {"index": [], "search": [], "genindex": []}
html_context = {"default_mode": "auto"}
html_theme_options = {
    "collapse_navigation": True,
    "header_links_before_dropdown": 6,
    "navbar_persistent": ["search-button"],
    "navbar_end": ["theme-switcher"],
    "navigation_with_keys": False,
    "primary_sidebar_end": [],
    "secondary_sidebar_items": ["page-toc", "notebook"],
    "show_toc_level": 2,
    "footer_start": ["version"],
    "footer_end": [],
}

# The page of all laws is generated from the laws, so that it contains every new law.
ZOO = """# The laws of the package

These laws (strain energies) come with the package. Each name in the first table links to the law's
equation and source. All laws work with all functions: pressure, stiffness, axial force, models,
evidence and classification. The [theory](theory/laws.md) explains how their stresses are computed.
You can [add your own law](guides/own_law.md) in a dozen lines.

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


def prior_of(parameter: ph.Parameter) -> str:
    """Return the limits of a default prior, as text."""
    return " to ".join(f"{round(end, 3):g}".replace("-", "−") for end in parameter.prior_range)


def name_of(parameter: ph.Parameter) -> str:
    """Return a parameter's name as code, with a note if it is a vector."""
    return f"`{parameter.name}`" + (", a vector" if parameter.size else "")


def write_zoo(names: list[str]) -> dict[str, list[tuple[str, ...]]]:
    """Write the page of all laws, and return a table of parameters for each law."""
    tables, rows = {}, []
    for law in map(ph.StrainEnergy.from_name, sorted(names)):
        tables[law.name] = [
            (p.symbol, name_of(p).replace("`", "``"), p.unit, prior_of(p), p.description)
            for p in law.parameters
        ]
        cell = f"{{class}}`~pymc_hyperelastic.{law.name}`"
        for p in law.parameters:
            about = f"{name_of(p)} | {p.unit} | {prior_of(p)} | {p.description}"
            rows.append(f"| {cell} | ${p.symbol}$ | {about} |")
            cell = ""
    summary = "\n".join(f"   {name}" for name in tables)
    page = ZOO.format(names=summary, rows="\n".join(rows))
    Path(__file__).with_name("strain_energies.md").write_text(page, encoding="utf-8")
    return tables


autosummary_context["parameters"] = write_zoo(autosummary_context["laws"])


def name_public_bases(app, name, obj, options, bases) -> None:
    """Show the nearest public base class, with the name that users import."""
    public = next(base for base in obj.__mro__[1:] if base.__name__ in (*ph.__all__, "object"))
    if bases and public is not object:
        bases[:] = [f":py:class:`~pymc_hyperelastic.{public.__name__}`"]


def link_elsewhere(app, env, node, content):
    """Link a name of another package to its documentation."""
    if address := LINKS.get(node["reftarget"]):
        return nodes.reference("", "", content, internal=False, refuri=address)


# Notebook pages can be downloaded as notebooks. Roles and links of Sphinx become plain text there.
ROLES = re.compile(r"\{(?:func|class|meth|data)\}`~?(?:pymc_hyperelastic\.)?([^`]+)`")
LINKED_PAGES = re.compile(r"\[([^\]]+)\]\((?!https?:)[^)]*\)|\{\w+\}`([^`<]+?)(?: <[^>]*>)?`")


def name_notebook(app, page, template, context, doctree) -> None:
    """Write the notebook of a page, and give its address to the template of the page."""
    source = str(app.env.doc2path(page)) if page in app.env.found_docs else ""
    if source.endswith(".md") and "file_format: mystnb" in Path(source).read_text("utf-8")[:300]:
        context["notebook"] = f"_downloads/notebooks/{page.replace('/', '_')}.ipynb"
        notebook = read_myst_markdown_notebook(Path(source).read_text("utf-8"))
        for cell in notebook.cells:
            if cell.cell_type == "markdown":
                cell.source = ROLES.sub(r"`\1`", cell.source)
                cell.source = LINKED_PAGES.sub(lambda m: m[1] or m[2], cell.source)
        target = Path(app.outdir, context["notebook"])
        target.parent.mkdir(parents=True, exist_ok=True)
        nbformat.write(notebook, target)


def show_stored(app, page, source) -> None:
    """Add the stored output and figures of an example to its page."""
    stored = Path(app.srcdir, "stored", Path(page).name)
    if page.startswith("gallery/") and (stored / "output.txt").exists():
        day, *printed = (stored / "output.txt").read_text(encoding="utf-8").splitlines()
        lines = [
            "",
            "Output and figures",
            "-" * 24,
            "",
            f"{day}.",
            "",
            ".. code-block:: none",
            "",
        ]
        lines += [f"   {line}" for line in printed] + [""]
        for figure in sorted(stored.glob("*.png")):
            caption = STORED_ALT["captions"].get(stored.name, {}).get(figure.stem, "")
            lines += [
                f".. figure:: /stored/{stored.name}/{figure.name}",
                f"   :alt: {STORED_ALT[stored.name][figure.stem]}",
                "",
                f"   {caption}",
                "",
            ]
        text, end, rest = source[0].rpartition("\n.. _sphx_glr_download_")
        source[0] = text + "\n".join(lines) + end + rest


# Steps in which pages are read: more than the parts into which Sphinx divides some 200 pages.
STEPS = 20


def spread_pages(app, env, pages) -> None:
    """Spread the guides, which run code, over all parts that Sphinx reads in parallel.

    In the order of their names, one process would read most of them.
    """
    pages[:] = [page for first in range(STEPS) for page in pages[first::STEPS]]


def setup(app) -> None:
    app.connect("env-before-read-docs", spread_pages)
    app.connect("source-read", show_stored)
    app.connect("html-page-context", name_notebook)
    app.connect("autodoc-process-bases", name_public_bases)
    app.connect("missing-reference", link_elsewhere)
