"""Figures inside a page: SVG that shares nothing with its neighbours, and asks for nothing."""

import re
from xml.etree import ElementTree

_SVG = "{http://www.w3.org/2000/svg}"
_LINK = "{http://www.w3.org/1999/xlink}href"
# CSS pixels of a point, and the share of its size down to which a figure shrinks on a small screen.
_PIXELS, _SMALLEST = 96 / 72, 0.72
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_FAMILY = re.compile(r"font-family:[^;]*;?\s*")
# The shorthand "font: italic 10px 'DejaVu Sans', ...".
_SHORTHAND = re.compile(r"font:\s*(italic|oblique)?[^;\d]*(?:\d+ )?([\d.]+px)[^;]*")
_DIGITS = re.compile(r"(\d\.\d\d)\d+")


def inline_svg(text: str, number: int, label: str) -> str:
    """What matplotlib wrote, as an image of a page with a label for those who do not see it.

    Names get the `number` of the figure, since a page has one space for all; fonts are left to the
    page; what no reader sees is left out, and hundredths of a point are enough.

    >>> drawing = '<svg xmlns="http://www.w3.org/2000/svg" width="72pt" height="36pt"/>'
    >>> inline_svg(drawing, 3, "nothing")
    '<svg width="96" height="48" role="img" aria-label="nothing" style="min-width: 69px" />'
    """
    root = ElementTree.fromstring(text)  # without comments
    for parent in root.iter():
        for child in list(parent):
            if child.tag in (f"{_SVG}metadata", f"{_SVG}style"):
                parent.remove(child)
    used = _referred(root)
    for element in root.iter():
        element.tag = element.tag.removeprefix(_SVG)
        element.attrib = _attributes(element.attrib, used, f"f{number}-")
        if element.tag != "text" and element.tag != "tspan":
            element.text = None
        element.tail = None
    width, height = (float(root.attrib[side][:-2]) * _PIXELS for side in ("width", "height"))
    root.attrib |= {"width": f"{width:.0f}", "height": f"{height:.0f}"}
    root.attrib |= {"role": "img", "aria-label": label}
    root.attrib |= {"style": f"min-width: {_SMALLEST * width:.0f}px"}
    return ElementTree.tostring(root, encoding="unicode")


def _referred(root: ElementTree.Element) -> set[str]:
    """Names that something refers to."""
    used: set[str] = set()
    for element in root.iter():
        for key, value in element.attrib.items():
            used |= set(_REFERENCE.findall(value))
            if key == _LINK:
                used.add(value.removeprefix("#"))
    return used


def _attributes(given: dict[str, str], used: set[str], prefix: str) -> dict[str, str]:
    kept = {}
    for key, value in given.items():
        value = _REFERENCE.sub(rf"url(#{prefix}\1)", value)
        if key == "id":
            if value not in used:
                continue
            value = prefix + value
        elif key == _LINK:
            key = "href"
            value = f"#{prefix}{value[1:]}" if value.startswith("#") else value
        elif key == "style":
            value = _SHORTHAND.sub(_without_family, _FAMILY.sub("", value)).strip("; ")
        elif key in ("d", "x", "y"):
            value = _DIGITS.sub(r"\1", " ".join(value.split()))
        if key != "version":
            kept[key] = value
    return kept


def _without_family(font: re.Match[str]) -> str:
    slanted = "font-style: italic; " if font[1] else ""
    return f"{slanted}font-size: {font[2]}"
