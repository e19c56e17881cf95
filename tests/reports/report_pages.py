"""Read a report as HTML: its elements, headings, text and tables."""

import base64
import itertools
from html.parser import HTMLParser
from xml.etree import ElementTree

VOID = {"meta", "br", "hr", "img", "input", "link", "area", "base", "col", "wbr"}


class Page(HTMLParser):
    """Elements, names, text and tables of a page.

    A cell of a table is a number, a tuple of the numbers of an estimate or an interval, or text.
    """

    def __init__(self, path):
        super().__init__()
        self.source = path.read_text(encoding="utf-8")
        self.open, self.wrong = [], []
        self.elements, self.texts, self.headings, self.tables = [], [], [], {}
        self._rows = self._caption = None
        self.feed(self.source)
        self.close()
        self.wrong += self.open

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag in ("h1", "h2", "h3"):
            self.headings.append([tag, ""])
        elif tag == "table":
            self._rows, self._caption = [], ""
        elif tag == "tr":
            self._rows.append([])
        elif tag in ("td", "th"):
            self._rows[-1].append("")
        elif tag == "data":
            number, before = float(dict(attrs)["value"]), self._rows[-1][-1]
            several = before if isinstance(before, tuple) else (before,)
            self._rows[-1][-1] = number if before == "" else (*several, number)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    @property
    def figures(self):
        """The label of each figure, and its drawing as SVG."""
        images = [attrs for tag, attrs in self.elements if tag == "img"]
        start = "data:image/svg+xml;base64,"
        assert all(image["src"].startswith(start) for image in images)
        return {
            image["alt"]: base64.b64decode(image["src"].removeprefix(start)).decode()
            for image in images
        }

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)
        if tag == "table":
            self.tables[self._caption.strip()] = self._rows
            self._rows = self._caption = None

    def handle_data(self, data):
        if self.open[-1:] != ["style"]:
            self.texts.append(data)
        if self.open and self.open[-1] in ("h1", "h2", "h3"):
            self.headings[-1][1] += data
        if "caption" in self.open:
            self._caption += data
        elif self.open and self.open[-1] in ("td", "th") and isinstance(self._rows[-1][-1], str):
            self._rows[-1][-1] += data

    @property
    def text(self):
        return " ".join(" ".join(self.texts).split())

    @property
    def chapters(self):
        return [text for tag, text in self.headings if tag == "h2"]

    @property
    def summary(self):
        """The text between the headings of the summary and of the warnings."""
        return self.text.split(" Summary ")[1].split(" Warnings ")[0]

    @property
    def warnings(self):
        """The text between the headings of the warnings and of the contents."""
        return self.text.split(" Warnings ")[1].split(" Contents ")[0]

    @property
    def methods(self):
        return self.text.split("Methods, for an article")[-1].split(" Software, and how")[0]

    def table(self, start):
        """Headings and rows of the table whose caption begins like this."""
        (found,) = [rows for caption, rows in self.tables.items() if caption.startswith(start)]
        return found[0], found[1:]

    def column(self, start, heading):
        headings, rows = self.table(start)
        return [row[headings.index(heading)] for row in rows]


def assert_sound(page):
    """Assert that a page is well formed, loads nothing, and has headings in order."""
    assert page.wrong == []
    ids = [attrs["id"] for _, attrs in page.elements if "id" in attrs]
    assert len(ids) == len(set(ids))
    for tag, attrs in page.elements:
        assert tag not in ("script", "link", "iframe", "object", "embed")
        assert not [name for name in attrs if name.startswith("on")]
        for name in ("href", "src"):
            if name in attrs:
                target = attrs[name]
                assert (target.startswith("#") and target[1:] in ids) or target.startswith("data:")
        if tag == "th":
            assert attrs["scope"] in ("col", "row")
    for drawing in page.figures.values():
        assert ElementTree.fromstring(drawing).tag.endswith("svg")
    assert "http://" not in page.source and "https://" not in page.source
    levels = [int(tag[1]) for tag, _ in page.headings]
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    assert page.chapters[:3] == ["Summary", "Warnings", "Contents"]
