"""Check every page of the built documentation in a browser, and check its links.

The program opens each page with the widths of a telephone and of a desktop, light and dark. It
lists the faults by page; the last line counts the checks. Run it with ``make docs-check``.
"""

import asyncio
import shutil
import sys
import threading
from collections import Counter
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urljoin, urlsplit

from axe_playwright_python.async_playwright import Axe
from playwright.async_api import Browser, async_playwright

SITE = Path(__file__).with_name("_build") / "html"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
WIDTHS, SCHEMES, AT_ONCE, TRIES = (1400, 400), ("light", "dark"), 4, 20
# Pages of source code have the same layout: the browser opens every twentieth of them. The links of
# all pages are checked.
STEP_OF_SOURCE_PAGES = 20
# In the dark scheme only the colours differ. The scrolling regions depend on the width.
RULES = {
    (1400, "light"): {},
    (1400, "dark"): {"runOnly": ["color-contrast"]},
    (400, "light"): {"runOnly": ["scrollable-region-focusable", "target-size"]},
}

# Formulas and links that are still source text, missing figures, and figures without an alternative
# text.
UNFINISHED = r"""() => [
    ...[...document.querySelectorAll(".math")].filter(e => !e.querySelector("math")),
    ...document.querySelectorAll(".temml-error, merror"),
    ...[...document.querySelectorAll("article :is(p, li, td, th, dd, dt, h1, h2)")].filter(e => {
        const text = e.cloneNode(true);
        text.querySelectorAll("code, pre, .math").forEach(inner => inner.remove());
        return /\$\$|\\\(|\\[a-z]+\{|\]\([^)]*\)|\{[a-z]+\}`/.test(text.textContent);
    }),
    ...[...document.images].filter(e => e.complete && !e.naturalWidth
        || !e.alt.trim() && !e.closest(".sphx-glr-thumbcontainer")),
].map(e => e.outerHTML.slice(0, 160))"""
# Text that is cut off or outside the screen. Code, tables and, on narrow screens, formulas may
# scroll inside an element that the keyboard can reach.
CUT_OFF = """(narrow) => [...document.querySelectorAll("body *")].filter(e => {
    if (e.closest("svg, math, dialog") || !e.checkVisibility()) return false;
    const style = getComputedStyle(e), box = e.getBoundingClientRect();
    if (box.width < 2 || style.clipPath !== "none") return false;
    const scrolls = e.scrollWidth > e.clientWidth + 1 && style.display !== "inline";
    if (["auto", "scroll"].includes(style.overflowX))
        return scrolls && (e.tabIndex !== 0 || e.matches(".formula") && !narrow);
    const hasText = [...e.childNodes].some(node => node.nodeType === 3 && node.data.trim());
    if (scrolls && hasText && style.overflowX === "hidden") return true;
    for (let place = e.parentElement; place; place = place.parentElement) {
        const outer = getComputedStyle(place).overflowX;
        if (["auto", "scroll"].includes(outer)) return false;
        if (outer === "hidden" && hasText && box.right > place.getBoundingClientRect().right + 1)
            return true;
    }
    return box.right > innerWidth + 1 && box.left < innerWidth || box.left < -1 && box.right > 0;
}).map(e => e.outerHTML.slice(0, 160))"""
SCROLLS_SIDEWAYS = "document.documentElement.scrollWidth > innerWidth"


class Page(HTMLParser):
    """Anchors and links of a page."""

    def __init__(self, path: Path):
        super().__init__()
        self.names, self.targets = set(), []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        """Record the anchors and links of an element."""
        attrs = dict(attrs)
        self.names |= {attrs[key] for key in ("id", "name") if attrs.get(key)}
        self.targets += [attrs[key] for key in ("href", "src") if attrs.get(key)]


def broken_links(pages: dict[str, Page]) -> tuple[int, list[str]]:
    """Return the number of links within the site, and a text for each broken link."""
    links, broken = 0, []
    for name, page in pages.items():
        for target in page.targets:
            split = urlsplit(urljoin(f"/{name}", target))
            if split.scheme or split.netloc:
                continue
            links += 1
            path = unquote(split.path).lstrip("/") or "index.html"
            known = path not in pages or split.fragment in {"", *pages[path].names}
            if not (SITE / path).exists() or not known:
                broken.append(f"{name}: broken link {target}")
    return links, broken


async def settled(page, script: str, *given) -> list[str]:
    """Run a script repeatedly until it finds no fault, and return the faults that remain.

    The theme marks scrolling regions a little after the page has loaded, later on a busy computer.
    """
    for _ in range(TRIES):
        if not (found := await page.evaluate(script, *given)):
            break
        await asyncio.sleep(0.25)
    return found


async def look(browser: Browser, address: str, name: str, wrong: list[str], seen: Counter) -> None:
    """Check a page in all widths and colour schemes, and add its faults to `wrong`."""
    page = await browser.new_page(viewport={"width": WIDTHS[0], "height": 900})
    at = ""

    def add(what: str) -> None:
        wrong.append(f"{name}{at}: {what}")

    def ask(request) -> None:
        seen["requests"] += 1
        if not request.url.startswith((address, "data:", "blob:")):
            add(f"request to {request.url}")

    page.on("request", ask)
    page.on("requestfailed", lambda request: add(f"failed request to {request.url}"))
    page.on("response", lambda r: add(f"{r.status} for {r.url}") if r.status >= 400 else None)
    page.on("pageerror", lambda error: add(f"error {error}"))
    page.on(
        "console",
        lambda said: add(f"console {said.text}") if said.type in ("error", "warning") else None,
    )
    await page.goto(f"{address}/{name}")
    await page.evaluate(  # images are loaded lazily: load all of them
        """Promise.all([...document.images].map(
            e => (e.loading = "eager", e.decode().catch(() => 0))))"""
    )
    for what in await settled(page, UNFINISHED):
        add(f"unfinished {what}")
    seen["formulas"] += await page.locator("math").count()
    seen["figures"] += await page.locator("article img").count()
    # Pages of source code: other pages check the style of code, and the frame of the page. One
    # check of the frame is enough.
    is_code = name.startswith("_modules/")
    rules = {(1400, "light"): {}} if is_code else RULES
    context = {"exclude": "pre"} if is_code else None
    for width in WIDTHS:
        await page.set_viewport_size({"width": width, "height": 900})
        cut_off = await settled(page, CUT_OFF, width < 1000)
        for scheme in SCHEMES:
            await page.emulate_media(color_scheme=scheme)
            at = f" ({width} px, {scheme})"
            seen["views"] += 1
            if scheme == "light":
                if await page.evaluate(SCROLLS_SIDEWAYS):
                    add("scrolls sideways")
                for what in cut_off:
                    add(f"cut off {what}")
            if (width, scheme) in rules:
                options = {"resultTypes": ["violations"], "preload": False, **rules[width, scheme]}
                found = await Axe().run(page, context=context, options=options)
                for violation in found.response["violations"]:
                    if violation["impact"] in ("serious", "critical"):
                        for node in violation["nodes"][:3]:
                            add(f"{violation['id']} {node['html'][:160]}")
    await page.close()


async def look_at_all(address: str, names: list[str]) -> tuple[list[str], Counter]:
    """Check all pages, several at the same time."""
    wrong, seen, places = [], Counter(pages=len(names)), asyncio.Semaphore(AT_ONCE)
    async with async_playwright() as started:
        arguments = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        browser = await started.chromium.launch(executable_path=CHROMIUM, args=arguments)

        async def look_in_turn(name: str) -> None:
            async with places:
                await look(browser, address, name, wrong, seen)

        await asyncio.gather(*map(look_in_turn, names))
        await browser.close()
    return wrong, seen


class Handler(SimpleHTTPRequestHandler):
    """Serve files without log messages."""

    def log_message(self, *_):
        """Write no log message."""


def main() -> None:
    """Check the whole site, or the pages whose names begin with one of the arguments."""
    if CHROMIUM is None:
        sys.exit("there is no chromium: apt-get install chromium")
    paths = sorted(SITE.rglob("*.html"))
    pages = {
        path.relative_to(SITE).as_posix(): Page(path)
        for path in paths
        if "_static" not in path.parts
    }
    links, broken = broken_links(pages)
    source = [name for name in pages if name.startswith("_modules/")]
    skipped = {*source} - {*source[::STEP_OF_SOURCE_PAGES]}
    names = [name for name in pages if name.startswith(tuple(sys.argv[1:]) or "")]
    names = [name for name in names if name not in skipped]
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=SITE))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    wrong, seen = asyncio.run(look_at_all(f"http://127.0.0.1:{server.server_port}", names))
    print(*sorted(broken + wrong), sep="\n")
    counts = ", ".join(f"{count} {what}" for what, count in {**seen, "links": links}.items())
    print(f"{len(broken) + len(wrong)} findings; looked at {counts}")
    sys.exit(bool(broken or wrong))


if __name__ == "__main__":
    main()
