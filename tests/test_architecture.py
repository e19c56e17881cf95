"""The architecture page, the API page and the package say the same."""

import ast
import re
from pathlib import Path

import pymc_hyperelastic as ph

PACKAGE = Path(ph.__file__).parent
DOCS = Path(__file__).parents[1] / "docs"

# The names that users' scripts rely on, by step of a study: more may join them, none may go.
CONTRACT = """
    inflation_data load_dataset list_datasets select mmHg
    StrainEnergy PowerLawNeoHookean Ogden CriscioneType
    inflation_pressure inflation_stiffness PressureIntegral
    inflation_model power_law_neo_hookean_model ogden_model criscione_model
    inflation_likelihood balanced_slope_weight
    sample_smc log_evidence predict_pressure
    fit_classes classify kl_divergence
    plot_inflation plot_parameter_density plot_pressure_fit plot_class_probability
""".split()


def mapped_modules() -> list[str]:
    """List the modules of the architecture page's table, from top to bottom, without suffix."""
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    return re.findall(r"^\| `(\w+)(?:\.py|/)` \|", page, flags=re.MULTILINE)


def packaged_modules() -> list[str]:
    return [
        path.stem
        for path in PACKAGE.iterdir()
        if path.suffix == ".py" or (path.is_dir() and path.name != "__pycache__")
    ]


def imported_modules(path: Path) -> set[str]:
    """Find the package's own modules that a file imports, anywhere in it."""
    folder = [PACKAGE.name, *path.relative_to(PACKAGE).parts[:-1]]
    dotted = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            dotted += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = folder[: len(folder) + 1 - node.level] if node.level else []
            module = ".".join([*base, *filter(None, [node.module])])
            dotted += [f"{module}.{alias.name}" for alias in node.names]
    parts = [name.split(".") for name in dotted]
    modules = [part[1] if len(part) > 1 else "" for part in parts if part[0] == PACKAGE.name]
    # What is no module is a name that the package's __init__ provides.
    return {name if name in packaged_modules() else "__init__" for name in modules}


def test_map_lists_exactly_the_modules():
    """The architecture page lists every module and package once, and none that is not there."""
    assert sorted(mapped_modules()) == sorted(packaged_modules())


def test_imports_point_upward():
    """Each module imports only from modules above it on the architecture page."""
    rank = {name: row for row, name in enumerate(mapped_modules())}
    imports = {
        (path.relative_to(PACKAGE).parts[0].removesuffix(".py"), target)
        for path in PACKAGE.rglob("*.py")
        for target in imported_modules(path)
    }
    between = {(importer, target) for importer, target in imports if importer != target}
    assert between, "no import was found: the search itself is broken"
    assert not {pair for pair in between if rank[pair[0]] <= rank[pair[1]]}


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
