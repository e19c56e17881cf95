"""The reference documents every public name, and all files state one version."""

import inspect
import re
import tomllib
from pathlib import Path

import pytest

import pymc_hyperelastic as ph

ROOT = Path(__file__).parents[1]
DOCUMENTED = [name for name in ph.__all__ if callable(getattr(ph, name))]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.mark.parametrize("name", DOCUMENTED)
def test_public_name_has_an_example_and_refers_to_public_names(name):
    text = inspect.getdoc(getattr(ph, name))
    beside = re.search(r"See Also\n-+\n((?:.+\n?)+)", text)[1]
    named = re.findall(r"^[\w, .]+?(?= : |$)", beside, re.MULTILINE)
    assert {other.strip() for line in named for other in line.split(",")} <= {*ph.__all__}
    assert re.search(r"Examples\n-+\n[^>]*>>> ", text)


def test_reference_lists_every_public_name_once():
    """Strain energies are listed on a page that the documentation generates."""
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    listed = re.findall(r"^(?:   |\.\. data:: )(\w+)$", page, flags=re.MULTILINE)
    assert sorted(listed) == sorted({*ph.__all__} - {*ph.list_strain_energies()})


def test_all_files_state_the_same_version_and_dependencies():
    version = PROJECT["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\n## {version}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"version = {{{version}}}" in (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    recipe = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    assert f"\n  version: {version}\n" in recipe
    needs = re.search(r"  run:\n((?:    - .+\n)+)", recipe)[1].replace("-base", "")
    needs = [need.removeprefix("    - ").replace(" ", "") for need in needs.splitlines()]
    assert needs == [f"python{PROJECT['requires-python']}", *PROJECT["dependencies"]]


@pytest.mark.parametrize(
    "kept", sorted((ROOT / "docs" / "stored").iterdir()), ids=lambda path: path.name
)
def test_example_with_stored_figures_has_a_stored_thumbnail(kept):
    text = (ROOT / "examples" / f"{kept.name}.py").read_text(encoding="utf-8")
    (picture,) = re.findall(r'^# sphinx_gallery_thumbnail_path = "(.*)"$', text, re.MULTILINE)
    assert (ROOT / "docs" / picture).parent == kept and (ROOT / "docs" / picture).exists()
    said = tomllib.loads((ROOT / "docs" / "stored_figures.toml").read_text(encoding="utf-8"))
    assert set(said[kept.name]) == {figure.stem for figure in kept.glob("*.png")}
