"""Imports of the package follow the architecture page."""

import ast
import math
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import pymc_hyperelastic as ph

PACKAGE = Path(ph.__file__).parent
DOCS = Path(__file__).parents[1] / "docs"
# Nats: five standard errors of 500 particles.
ALONE_TOLERANCE = 0.15


def page() -> str:
    return (DOCS / "project" / "architecture.md").read_text(encoding="utf-8")


def mapped_layers() -> list[str]:
    """List the layers of the page's first table, from top to bottom."""
    return re.findall(r"^\| `(\w+)(?:\.py|/)` \|", page().split("\n## ")[0], flags=re.MULTILINE)


def mapped_modules(layer: str) -> list[str]:
    """List the modules of a layer's table, from top to bottom, without suffix."""
    section = next(s for s in page().split("\n## ") if s.startswith(f"`{layer}/`\n"))
    return re.findall(r"^\| `(\w+)(?:\.py|/)` \|", section, flags=re.MULTILINE)


def inside(folder: Path) -> list[str]:
    """List the modules and packages of a folder."""
    return [
        path.stem
        for path in folder.iterdir()
        if (path.suffix == ".py" and path.stem not in ("__init__", "__main__"))
        or (path.is_dir() and path.name != "__pycache__")
    ]


@cache
def imports(path: Path) -> set[tuple[str, ...]]:
    """Return the names that a file imports from the package, each as a tuple of its parts."""
    folder = [PACKAGE.name, *path.relative_to(PACKAGE).parts[:-1]]
    dotted = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            dotted += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = folder[: len(folder) + 1 - node.level] if node.level else []
            module = ".".join([*base, *filter(None, [node.module])])
            dotted += [f"{module}.{alias.name}" for alias in node.names]
    parts = (tuple(name.split(".")) for name in dotted)
    return {part[1:] for part in parts if part[0] == PACKAGE.name}


def imports_within(folder: Path, below: tuple[str, ...] = ()) -> set[tuple[str, str]]:
    """Return pairs of importing and imported modules of a folder; "" stands for other names."""
    known = inside(folder)
    found = set()
    for name in known:
        paths = [folder / f"{name}.py"] if (folder / f"{name}.py").exists() else []
        for path in [*paths, *(folder / name).rglob("*.py")]:
            for target in imports(path):
                if target[: len(below)] == below:
                    first = (*target[len(below) :], "")[0]
                    found.add((name, first if first in known else ""))
    return {(importer, target) for importer, target in found if importer != target}


def test_architecture_page_lists_every_layer_and_module_once():
    assert sorted(mapped_layers()) == sorted(inside(PACKAGE))
    for layer in mapped_layers():
        if not (PACKAGE / layer).is_dir():
            continue
        assert sorted(mapped_modules(layer)) == sorted(inside(PACKAGE / layer)), layer


def assert_upward(order: list[str], found: set[tuple[str, str]]) -> None:
    rank = {name: row for row, name in enumerate(order)}
    assert found, "no import was found: the search itself is broken"
    # A name that is no module is provided by the __init__ of the package or the layer.
    last = len(order)
    assert not {pair for pair in found if rank[pair[0]] <= rank.get(pair[1], last)}


def test_wings_import_only_from_wings_above_them_on_the_page():
    assert_upward(mapped_layers(), imports_within(PACKAGE))


@pytest.mark.parametrize(
    "layer",
    ["parallel", "mechanics", "data", "evidence", "models", "io", "classes", "plots", "reports"],
)
def test_modules_import_only_from_modules_above_them_in_their_layer(layer):
    assert_upward(mapped_modules(layer), imports_within(PACKAGE / layer, (layer,)))


# Modules that integrate over a wall; other modules use the forward model or a named integral.
INTEGRATORS = {
    "mechanics": {"collocation", "selected_nodes", "wall"},
    "models/forward": {
        "choose",
        "integrator",
        "model",
        "numbers",
        "tabulated",
        "tube_variables",
    },
}


def test_only_mechanics_and_the_forward_model_import_integrators():
    hidden = {(*folder.split("/"), name) for folder, names in INTEGRATORS.items() for name in names}
    assert all((PACKAGE / Path(*part).with_suffix(".py")).exists() for part in hidden)
    own = [PACKAGE / folder for folder in INTEGRATORS]
    others = [p for p in PACKAGE.rglob("*.py") if not any(folder in p.parents for folder in own)]
    names = [(path, name) for path in others for name in imports(path)]
    assert not [(path, name) for path, name in names if hidden & {name[:2], name[:3]}]
    forward = [path for path, name in names if name[:2] == ("models", "forward")]
    assert forward, "no import was found: the search itself is broken"


EVIDENCE_ALONE = """
import sys, types
from importlib.machinery import PathFinder

package, others = types.ModuleType("pymc_hyperelastic"), {others!r}
package.__path__ = [{folder!r}]
sys.modules["pymc_hyperelastic"] = package


class Walled:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[:1] == ["pymc_hyperelastic"] and name.split(".")[1] in others:
            raise ImportError(f"{{name}} is another layer")


sys.meta_path.insert(0, Walled())
import pkgutil, importlib
import pymc_hyperelastic.evidence as evidence

for module in pkgutil.iter_modules(evidence.__path__):
    importlib.import_module(f"pymc_hyperelastic.evidence.{{module.name}}")

import pymc as pm
from pymc_hyperelastic.evidence.diagnosis import log_evidence
from pymc_hyperelastic.evidence.smc import sample_smc

with pm.Model() as model:
    mean = pm.Normal("mean", 0.0, 3.0)
    pm.Normal("y", mean, 4.0, observed=1.0)
tree = sample_smc(model, 500, 1, 1, False)
print(log_evidence(tree).value)
"""


def test_evidence_samples_a_model_if_other_wings_cannot_be_imported():
    others = [
        layer for layer in inside(PACKAGE) if layer not in ("evidence", "messages", "parallel")
    ]
    code = EVIDENCE_ALONE.format(others=others, folder=str(PACKAGE))
    in_python = os.environ | {"PYTENSOR_FLAGS": "mode=FAST_COMPILE"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, env=in_python)
    assert done.returncode == 0, done.stderr
    # ln N(1; 0, √(3² + 4²))
    exact = -0.5 * math.log(2 * math.pi * 25) - 1 / 50
    assert abs(float(done.stdout) - exact) < ALONE_TOLERANCE
