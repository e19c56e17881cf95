// Formulas are written as MathML, which every browser draws by itself and screen readers read.
document.addEventListener("DOMContentLoaded", () => {
    for (const place of document.querySelectorAll(".math")) {
        const displayed = place.tagName === "DIV";
        const texts = [...place.childNodes].filter((node) => node.nodeType === Node.TEXT_NODE);
        for (const text of texts.filter((node) => node.data.trim())) {
            const tex = text.data.trim().replace(/^\\[([]|\\[\])]$/g, "");
            const formula = document.createElement("span");
            if (displayed) formula.classList.add("formula");
            temml.render(tex, formula, { displayMode: displayed });
            text.replaceWith(formula);
        }
    }
    nameScrolled();
});
addEventListener("resize", nameScrolled);

// A formula that is wider than its place scrolls there: keys reach it, and it says so.
function nameScrolled() {
    for (const formula of document.querySelectorAll(".formula")) {
        const scrolls = formula.scrollWidth > formula.clientWidth;
        formula.tabIndex = scrolls ? 0 : -1;
        formula.role = scrolls ? "group" : null;
        formula.ariaLabel = scrolls ? "Formula, to be scrolled sideways" : null;
    }
}
