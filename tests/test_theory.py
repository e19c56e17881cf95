"""Pages of the theory number their equations, and the glossary uses names of the code."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
THEORY = {path.name: path.read_text("utf-8") for path in sorted(DOCS.glob("theory/*.md"))}


def test_every_displayed_equation_of_the_theory_has_a_label_of_its_own():
    labels = []
    for name, page in THEORY.items():
        assert "$$" not in page, name
        blocks = re.findall(r"^ *```\{math\}\n *(.*)$", page, re.MULTILINE)
        assert not [first for first in blocks if not first.startswith(":label: ")], name
        labels += [first.removeprefix(":label: ") for first in blocks]
    assert labels and len(labels) == len({*labels})


def test_every_reference_to_an_equation_leads_to_one():
    labels = {label for page in THEORY.values() for label in re.findall(r":label: (\S+)", page)}
    pages = [path.read_text("utf-8") for path in DOCS.rglob("*.md")]
    referred = {label for page in pages for label in re.findall(r"\{eq\}`([^`]+)`", page)}
    assert referred and referred <= labels


def test_names_in_the_glossary_are_names_in_the_code():
    page = (DOCS / "project" / "glossary.md").read_text("utf-8")
    code = "".join(p.read_text("utf-8") for p in ROOT.glob("pymc_hyperelastic/**/*.py"))
    names = {*re.findall(r"`(?:~pymc_hyperelastic\.)?([A-Za-z_]\w+)`", page)}
    assert names and not [name for name in names if not re.search(rf"\b{name}\b", code)]
