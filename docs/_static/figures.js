// Each figure is a link to itself, so that it opens in full size: a narrow screen shows it smaller.
document.addEventListener("DOMContentLoaded", () => {
    for (const figure of document.querySelectorAll("article img")) {
        if (figure.closest("a, .sd-card, .sphx-glr-thumbcontainer")) continue;
        const link = document.createElement("a");
        // The last address of a set is that of the sharpest picture.
        link.href = figure.srcset.split(",").at(-1).trim().split(" ")[0] || figure.src;
        link.className = "whole-figure";
        figure.replaceWith(link);
        link.append(figure);
    }
});
