"""The architecture page, the API page and the package say the same."""

import ast
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest

import pymc_hyperelastic as ph

PACKAGE = Path(ph.__file__).parent
DOCS = Path(__file__).parents[1] / "docs"
# Nats: five standard errors of 500 particles.
ALONE_TOLERANCE = 0.15

# The names that users' scripts rely on, by step of a study: more may join them, none may go.
CONTRACT = """
    inflation_data load_dataset list_datasets select mmHg
    StrainEnergy PowerLawNeoHookean Ogden CriscioneType
    inflation_pressure inflation_stiffness PressureIntegral
    inflation_model power_law_neo_hookean_model ogden_model criscione_model
    inflation_likelihood balanced_slope_weight
    sample_smc log_evidence predict_pressure
    fit_classes classify compare_classes kl_divergence
    plot_inflation plot_parameter_density plot_pressure_fit plot_class_probability
""".split()


def page() -> str:
    return (DOCS / "project" / "architecture.md").read_text(encoding="utf-8")


def mapped_wings() -> list[str]:
    """List the wings of the page's first table, from top to bottom."""
    return re.findall(r"^\| `(\w+)/` \|", page().split("\n## ")[0], flags=re.MULTILINE)


def mapped_rooms(wing: str) -> list[str]:
    """List the rooms of a wing's table, from top to bottom, without suffix."""
    section = next(s for s in page().split("\n## ") if s.startswith(f"`{wing}/`\n"))
    return re.findall(r"^\| `(\w+)(?:\.py|/)` \|", section, flags=re.MULTILINE)


def inside(folder: Path) -> list[str]:
    """Modules and packages of a folder."""
    return [
        path.stem
        for path in folder.iterdir()
        if (path.suffix == ".py" and path.stem not in ("__init__", "__main__"))
        or (path.is_dir() and path.name != "__pycache__")
    ]


def imports(path: Path) -> set[tuple[str, ...]]:
    """Parts of the names that a file imports from the package, anywhere in it."""
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


def arrows(folder: Path, below: tuple[str, ...] = ()) -> set[tuple[str, str]]:
    """Which of a folder's modules and packages import which others; names of its own as ""."""
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


def test_map_lists_exactly_the_wings_and_rooms():
    """The architecture page lists every wing and room once, and none that is not there."""
    assert sorted(mapped_wings()) == sorted(inside(PACKAGE))
    for wing in mapped_wings():
        assert sorted(mapped_rooms(wing)) == sorted(inside(PACKAGE / wing)), wing


def assert_upward(order: list[str], found: set[tuple[str, str]]) -> None:
    rank = {name: row for row, name in enumerate(order)}
    assert found, "no import was found: the search itself is broken"
    # What is no module is a name that the package's, or the wing's, __init__ provides.
    last = len(order)
    assert not {pair for pair in found if rank[pair[0]] <= rank.get(pair[1], last)}


def test_imports_between_wings_point_upward():
    """Each wing imports only from those above it on the architecture page."""
    assert_upward(mapped_wings(), arrows(PACKAGE))


@pytest.mark.parametrize(
    "wing",
    ["files", "mechanics", "data", "evidence", "models", "classes", "cohorts", "plots", "reports"],
)
def test_imports_within_a_wing_point_upward(wing):
    """Each room imports only from those above it in its wing."""
    assert_upward(mapped_rooms(wing), arrows(PACKAGE / wing, (wing,)))


def test_nobody_else_knows_how_a_wall_is_integrated():
    """Outside mechanics and the forward model only a user's `mode` speaks of it."""
    word = re.compile("collocat|quadrature rule|quadrature of the wall|\\bRule\\b", re.IGNORECASE)
    known = (PACKAGE / "mechanics", PACKAGE / "models" / "forward")
    for path in PACKAGE.rglob("*.py"):
        if not any(folder in path.parents for folder in known):
            lines = path.read_text(encoding="utf-8").splitlines()
            told = [line for line in lines if word.search(line)]
            assert not [line for line in told if "mode" not in line], path


ALONE = """
import sys, types
from importlib.machinery import PathFinder

package, others = types.ModuleType("pymc_hyperelastic"), {others!r}
package.__path__ = [{folder!r}]
sys.modules["pymc_hyperelastic"] = package


class Walled:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[:1] == ["pymc_hyperelastic"] and name.split(".")[1] in others:
            raise ImportError(f"{{name}} is another wing")


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


def test_evidence_is_a_library_of_its_own():
    """It samples a model in a process in which no wing that knows of tubes can be imported."""
    others = [wing for wing in inside(PACKAGE) if wing not in ("evidence", "files")]
    code = ALONE.format(others=others, folder=str(PACKAGE))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    # ln N(1; 0, √(3² + 4²))
    exact = -0.5 * math.log(2 * math.pi * 25) - 1 / 50
    assert abs(float(done.stdout) - exact) < ALONE_TOLERANCE


def test_contract_is_exported():
    """Every name that users' scripts rely on is in ``__all__`` and can be reached."""
    assert not set(CONTRACT) - set(ph.__all__)
    assert not [name for name in ph.__all__ if not hasattr(ph, name)]


def test_api_page_lists_exactly_the_public_names():
    """The API page documents every public name once, and none that is not public.

    The laws stand elsewhere, on a page that the documentation writes from the list of them.
    """
    page = (DOCS / "api.md").read_text(encoding="utf-8")
    listed = re.findall(r"^(?:   |\.\. data:: )(\w+)$", page, flags=re.MULTILINE)
    laws = set(ph.list_strain_energies())
    assert sorted(listed) == sorted(set(ph.__all__) - laws)
