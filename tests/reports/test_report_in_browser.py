"""Reports in a browser: on narrow and wide screens, light and dark, and on paper."""

import shutil

import fits
import numpy as np
import pytest
from report_pages import Page
from stored_results import classified, curves, fitted_classes

import pymc_hyperelastic as ph

pytestmark = pytest.mark.deep

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
QUIET = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]
LONG = "specimen_" + "with_a_name_that_does_not_end_" * 6

# Elements whose content overflows. Regions that scroll, and the link that is hidden until it has
# the focus, are excluded.
OVERFLOWS = """() => [...document.querySelectorAll("body *")].filter(e => {
    if (e.matches(".skip")) return false;
    const wide = e.scrollWidth > e.clientWidth + 1;
    if (e.closest(".scroll")) return e.matches("td, th, caption") && wide;
    const box = e.getBoundingClientRect();
    return box.right > innerWidth + 1 || box.left < -1
        || wide && getComputedStyle(e).display !== "inline";
}).map(e => e.outerHTML.slice(0, 120))"""
# Regions that scroll sideways have to be reached by keys, and have a name.
SCROLLED = """() => [...document.querySelectorAll(".scroll")]
    .filter(e => e.scrollWidth > e.clientWidth)
    .filter(e => e.tabIndex !== 0 || !document.getElementById(e.getAttribute("aria-labelledby")))
    .length"""
# Figures that are not drawn, or so small that their text cannot be read.
ILLEGIBLE = """() => [...document.querySelectorAll("figure img")]
    .filter(e => !e.naturalWidth || e.clientWidth < 0.7 * e.naturalWidth)
    .map(e => e.alt)"""
# Text of a drawing that is outside of it. The box of a formula also holds the blanks between its
# letters, which stand elsewhere: its letters are looked at one by one.
CUT_OFF = """() => [
    ...document.querySelectorAll("svg tspan, svg text:not(:has(tspan))")
].filter(e => {
    const box = e.getBoundingClientRect(), frame = e.closest("svg").getBoundingClientRect();
    return box.left < frame.left - 2 || box.right > frame.right + 2 || box.top < frame.top - 2
        || box.bottom > frame.bottom + 2;
}).map(e => e.textContent)"""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return the report of hierarchical classes, and of specimens with long names and warnings."""
    result = classified(
        [LONG, "S2"],
        [[0.5, 0.5], [0.9, 0.1]],
        decision=np.array(["cannot be judged", "undecided"]),
        class_probability_se=np.array([[np.inf] * 2, [0.1] * 2]),
    )
    classes = fits.fit("neo_hookean_classes")
    compared = ph.compare_classes(classes, ["mu", "log_reference_strain"], random_seed=1)
    results = {"Classes": classes, "Old": fitted_classes(), LONG: result, "Compared": compared}
    path = tmp_path_factory.mktemp("report") / "report.html"
    return ph.report(results, path, data={"Data": curves([LONG, "S2"])})


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("there is no chromium: apt-get install chromium")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=QUIET)
        yield chromium
        chromium.close()


@pytest.fixture(params=[(400, "light"), (400, "dark"), (1400, "light"), (1400, "dark")])
def opened(request, browser, path):
    """Return a page, the addresses it requested, and its console messages."""
    width, scheme = request.param
    screen = {"viewport": {"width": width, "height": 900}, "color_scheme": scheme}
    context = browser.new_context(**screen)
    page, asked, said = context.new_page(), [], []
    page.on("request", lambda asking: asked.append(asking.url))
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(path.as_uri())
    yield page, asked, said
    context.close()


def test_page_loads_and_logs_nothing_and_no_content_overflows(opened, path):
    page, asked, said = opened
    assert asked == [path.as_uri()]
    assert said == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert page.evaluate(OVERFLOWS) == []
    assert page.evaluate(SCROLLED) == 0
    assert page.evaluate(ILLEGIBLE) == []


def test_text_of_figures_is_inside_the_drawing(browser, path):
    page, drawings = browser.new_page(), Page(path).figures
    assert drawings
    for label, drawing in drawings.items():
        page.set_content(drawing)
        assert page.evaluate(CUT_OFF) == [], label
    page.close()


def test_axe_finds_no_serious_violation(opened):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    page, *_ = opened
    found = axe.Axe().run(page).response["violations"]
    grave = [
        (v["id"], [node["html"][:150] for node in v["nodes"]][:3])
        for v in found
        if v["impact"] in ("serious", "critical")
    ]
    assert grave == []


def test_page_prints_dark_on_white(opened):
    page, *_ = opened
    page.set_viewport_size({"width": 680, "height": 900})
    page.emulate_media(media="print")
    ground, ink = (
        page.evaluate(f"getComputedStyle(document.body).{name}")
        for name in ("backgroundColor", "color")
    )
    assert ground == "rgb(255, 255, 255)" and ink == "rgb(26, 29, 33)"
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert len(page.pdf(format="A4")) > 20_000
