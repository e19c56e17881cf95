"""The script that lists sentences that are hard to read."""

import re
from pathlib import Path

import plain_english
import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = re.findall(
    r"^\| ([^|`-].+?) \| ([^|`]+?) \|$",
    (ROOT / "docs" / "project" / "writing.md")
    .read_text(encoding="utf-8")
    .partition("\n## Sentences\n")[2]
    .partition("\n## ")[0],
    flags=re.MULTILINE,
)[1:]
# Four words are a sentence, and no string that the script would list in this file.
HARD = "Of all, one remains."


def found(path: Path, text: str) -> list[int]:
    """Return the lines of the paragraphs in which the script finds sentences that are hard."""
    path.write_text(text, encoding="utf-8")
    sentences = plain_english.sentences(path)
    return [line for line, sentence in sentences if plain_english.find_problems(sentence)]


@pytest.mark.parametrize(("before", "after"), EXAMPLES)
def test_examples_of_the_page_on_writing_are_reported_until_they_are_rewritten(before, after):
    assert plain_english.find_problems(before)
    assert not plain_english.find_problems(after)


def test_page_on_writing_has_an_example_of_every_problem():
    problems = {p for before, _ in EXAMPLES for p in plain_english.find_problems(before)}
    assert problems == {*plain_english.PATTERNS}


@pytest.mark.parametrize(
    "sentence",
    [
        "What is a class of specimens?",
        "Of course the pressure rises.",
        "Whether to show a progress bar.",
        "Whole studies as short scripts.",
        "Where ``axial_force`` is NaN, no force was measured.",
        "The wall is so thin that the stress is uniform.",
        "The radius at which the pressure is 10 kPa.",
        "Place the labels in their order.",
    ],
)
def test_plain_sentences_are_not_reported(sentence):
    assert not plain_english.find_problems(sentence)


def test_markdown_is_read_without_code_formulas_tables_and_headings(tmp_path):
    ignored = ["---", HARD, "---", f"# {HARD}", "```", HARD, "```", f"| {HARD} |", "$$", HARD, "$$"]
    read = ["", "A plain sentence is here.", HARD, f"- A short item. {HARD}", f"> {HARD}"]
    read += ["", f"**A first part in bold.** {HARD}"]
    assert found(tmp_path / "page.md", "\n".join([*ignored, *read])) == [13, 15, 15, 18]
    assert found(tmp_path / "page.md", f"$$ x $$\n\n:::{{note}}\n{HARD}\n:::\n") == [4]


def test_restructured_text_is_read_without_literal_blocks_and_headings(tmp_path):
    heading = f"{HARD}\n{'=' * len(HARD)}\n"
    block = f"A block of code follows here::\n\n    {HARD}\n\n    {HARD}\n\n"
    note = f".. note::\n\n    {HARD}\n"
    assert found(tmp_path / "page.rst", heading + block + note) == [11]


def test_python_is_read_in_docstrings_comments_and_messages(tmp_path):
    lines = [
        f'"""State what the module does. {HARD}',
        "",
        "Parameters",
        "----------",
        "what, is_known : what is",
        f"    {HARD}",
        "",
        f">>> print('{HARD}')",
        HARD,
        '"""',
        f"x = 1  # {HARD}",
        "",
        "# A comment of two lines. Of",
        "# all, one remains.",
        f"y = f'The file {{x}} has a message. {HARD}'",
        "z = f'a name: {x}'",
    ]
    assert found(tmp_path / "module.py", "\n".join(lines)) == [1, 6, 15, 11, 13]


def test_limit_is_a_share_of_the_sentences_of_each_folder(tmp_path, capsys):
    for folder, hard in {"one": 2, "other": 1}.items():
        (tmp_path / folder).mkdir()
        text = "\n\n".join(["This one is plain."] * (101 - hard) + [HARD] * hard)
        (tmp_path / folder / "page.md").write_text(text, encoding="utf-8")
    hidden = [tmp_path / ".venv", tmp_path / "one" / "_build"]
    for folder in hidden:
        folder.mkdir()
        (folder / "page.md").write_text(HARD, encoding="utf-8")
    # One per cent of 101 sentences, rounded up, is two.
    assert plain_english.main([str(tmp_path), "--limit", "1"]) == 0
    assert capsys.readouterr().out.count(HARD) == 3
    assert plain_english.main([str(tmp_path), "--limit", "0.9", "--count"]) == 1
    table = capsys.readouterr().out.splitlines()
    failed = [line.split()[0] for line in table if "at most" in line]
    assert failed == [str(tmp_path / "one")]
    assert table[-1] == "202 sentences, 3 hard to read"


def test_path_that_cannot_be_read_is_an_error(tmp_path):
    with pytest.raises(SystemExit):
        plain_english.main([str(tmp_path / "missing.md")])
