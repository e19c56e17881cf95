"""List sentences that are hard to read: inverted ones, riddles, and pronouns without a noun.

The script reads docstrings, comments and messages of Python files, and Markdown and
reStructuredText. ``make plain`` runs it on the whole project; ``docs/project/writing.md`` shows how
to rewrite a sentence. The patterns are rough, so each folder may have a few matches.
"""

import argparse
import ast
import io
import itertools
import math
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
RELATIVE = r"\b(at|by|from|in|of|to|with) wh(ich|om)\b"
# Names of problems, and the patterns that find them.
PATTERNS = {
    "starts with 'Of'": r"^Of (?!course\b)",
    "starts as a question": r"^(What|Which|Who|Whoever|Whose|Whether)\b(?! to\b)(?!.*\?$)",
    "starts with a place or a degree": (
        r"^(Where(?! ``)|As far as|So (far|many|much)|By (it|these)|To these)\b"
    ),
    "so many, so much": r"\bso (few|many|much)\b(?! that)",
    "no noun before 'that' or after 'what'": (
        r"\b(those (that|which|(of|by) which)|"
        r"what (is|was|has|it|they|there|can|may|could|follows))\b"
    ),
    "two relative clauses with prepositions": f"{RELATIVE}.*{RELATIVE}",
    "a thing that speaks or acts": r"\b(plays? (a|no) part|tells?|told)\b",
    "passive that hides who acts": r"\bIt is (asked|known|looked|said|that|told)\b",
    "a noun that denies": r"\b([Nn]obody|[Nn]othing (else|is|was)|[Tt]here (are|is) none)\b",
    "old-fashioned reference": r"\b(in (its|the|their) place|thereof|wherein|whereof|therein)\b",
}
COMPILED = {problem: re.compile(pattern) for problem, pattern in PATTERNS.items()}
# A sentence ends before a capital letter, a code span or emphasis; its own emphasis may end there.
SENTENCE_END = re.compile(r"(?:(?<=[.:;!?])|(?<=[.:;!?]\*\*))\s+(?=[A-Z`*])")
# Words of the shortest sentence and of the shortest string to read: shorter ones are names.
SENTENCE_WORDS, STRING_WORDS = 4, 5
BULLET = re.compile(r"^([-*+]|\d+\.) +")
# Lines without sentences: in Markdown tables, headings, rules, options and labels; in
# reStructuredText underlines, directives, options, templates and "name : type".
NO_MARKDOWN = re.compile(r"[|#:]|---|\([\w-]+\)=$")
UNDERLINE = re.compile(r"([-=~^])\1{2,}$")
NO_RESTRUCTURED = re.compile(rf"{UNDERLINE.pattern}|\.\. |[:{{]|[\w*, ]+ : ")
# Directives whose content is not text; "::" at the end of a line starts a literal block.
BLOCK = re.compile(r"\.\. (math|code|code-block|list-table)::|(?!\.\. ).*::$")
# Folders and files that targets of the Makefile write.
BUILT = {"_build", "build", "dist", "gallery", "generated", "results", "strain_energies.md"}
Line = tuple[int, str]


def find_problems(sentence: str) -> tuple[str, ...]:
    """Return the problem of each pattern that matches a sentence."""
    return tuple(problem for problem, pattern in COMPILED.items() if pattern.search(sentence))


def paragraphs(lines: Iterable[Line]) -> Iterator[Line]:
    """Join lines into paragraphs, which end at an empty line and before an item of a list."""
    start, words = 0, list[str]()
    for number, text in itertools.chain(lines, [(0, "")]):
        if words and (not text or BULLET.match(text)):
            yield start, " ".join(words)
            words = []
        if text:
            start = start if words else number
            words += (text if words else BULLET.sub("", text, count=1)).split()


def markdown(source: str) -> Iterator[Line]:
    """Yield the paragraphs of Markdown, without code, formulas, tables and headings."""
    lines, end = list[Line](), ""
    for number, line in enumerate(source.splitlines(), 1):
        text = line.strip()
        fence = re.match(r"```|~~~|\$\$(?!.*\$\$)|---(?=$)", text)
        is_text = not (end or fence or NO_MARKDOWN.match(text) or text.startswith("$$"))
        lines.append((number, text.lstrip("> ") if is_text else ""))
        if end:
            end = "" if text.startswith(end) else end
        elif fence and (fence[0] != "---" or number == 1):
            end = fence[0]
    return paragraphs(lines)


def restructured(source: str) -> Iterator[Line]:
    """Yield the paragraphs of reStructuredText, without code, formulas and headings.

    A change of the indentation ends a paragraph, as between a parameter and its description.
    """
    lines, doctest = list[Line](), False
    before, block = None, math.inf  # indentation of the text before, and of a block of code
    for number, line in enumerate(source.splitlines(), 1):
        text = line.strip()
        indent = len(line) - len(line.lstrip())
        doctest = text.startswith(">>>") or (doctest and text != "")
        block = math.inf if text and indent <= block else block
        if text and before not in (indent, None):
            lines.append((number, ""))
        if UNDERLINE.match(text):
            lines[-1:] = [(number, "")]  # the heading
        skipped = doctest or block < math.inf or NO_RESTRUCTURED.match(text)
        lines.append((number, "" if skipped else text.removesuffix(":")))
        block = min(block, indent) if BLOCK.match(text) else block
        bullet = BULLET.match(text)
        # The indentation of the first line of a docstring is not known.
        before = None if number == 1 or not text else indent + len(bullet[0] if bullet else "")
    return paragraphs(lines)


def strings(tree: ast.AST) -> Iterator[Line]:
    """Yield the strings of a module and their first lines; {} stands for a formatted value."""
    parts = set[ast.AST]()
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts.update(ast.walk(node))
            values = (v.value if isinstance(v, ast.Constant) else "{}" for v in node.values)
            yield node.lineno, "".join(map(str, values))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in parts:
            yield node.lineno, node.value


def python(source: str) -> Iterator[Line]:
    """Yield the paragraphs of the docstrings, messages and comments of a Python module."""
    for start, string in strings(ast.parse(source)):
        if len(string.split()) >= STRING_WORDS:
            yield from ((start + line - 1, text) for line, text in restructured(string))
    comments = list[Line]()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            if comments and token.start[0] != comments[-1][0] + 1:
                comments.append((0, ""))
            comments.append((token.start[0], token.string.lstrip("#: ")))
    yield from paragraphs(comments)


READERS = {".py": python, ".md": markdown, ".rst": restructured}


def sentences(path: Path) -> Iterator[Line]:
    """Yield the sentences of a file, and the first line of the paragraph of each."""
    for line, paragraph in READERS[path.suffix](path.read_text(encoding="utf-8")):
        for text in SENTENCE_END.split(paragraph):
            if len(text.split()) >= SENTENCE_WORDS:
                yield line, text


def files(path: Path) -> Iterator[Path]:
    """Yield a file, or the readable files of a folder that are neither hidden nor built."""
    if path.is_file():
        yield path
    for parent, folders, names in path.walk():
        folders[:] = [f for f in sorted(folders) if f not in BUILT and not f.startswith(".")]
        found = (parent / name for name in sorted(names) if name not in BUILT)
        yield from (file for file in found if file.suffix in READERS)


def folder(path: Path) -> str:
    """Return the folder under which a file is counted: at most two levels below the project."""
    parent = path.resolve().parent
    inside = parent.is_relative_to(ROOT)
    return "/".join(parent.relative_to(ROOT).parts[:2]) or "." if inside else str(parent)


def main(arguments: list[str] | None = None) -> int:
    """List or count sentences; return 1 if a folder has more problems than the limit allows."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("paths", nargs="*", type=Path, default=[ROOT], help="files or folders")
    parser.add_argument("--count", action="store_true", help="print a table of the folders only")
    limit = "largest share of the sentences of a folder in per cent, rounded up to a sentence"
    parser.add_argument("--limit", type=float, default=100.0, help=limit)
    options = parser.parse_args(arguments)
    for path in options.paths:
        if not path.is_dir() and not (path.is_file() and path.suffix in READERS):
            parser.error(f"{path} is neither a folder nor a file of type {', '.join(READERS)}")
    total, hard = Counter[str](), Counter[str]()
    for file in itertools.chain.from_iterable(map(files, options.paths)):
        name = folder(file)
        for line, sentence in sentences(file):
            problems = find_problems(sentence)
            total[name] += 1
            hard[name] += bool(problems)
            if problems and not options.count:
                print(f"{file}:{line}: {'; '.join(problems)}: {sentence}")
    allowed = {name: math.ceil(number * options.limit / 100) for name, number in total.items()}
    failed = [name for name in sorted(total) if hard[name] > allowed[name]]
    for name in sorted(total) if options.count else failed:
        note = f": at most {allowed[name]}" if name in failed else ""
        print(f"{name:32} {total[name]:5} sentences, {hard[name]:3} hard to read{note}")
    print(f"{total.total()} sentences, {hard.total()} hard to read")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
