// What the theme leaves without a name, or with a role that it does not fill, for those who hear a page.
document.addEventListener("DOMContentLoaded", () => {
    for (const toggle of document.querySelectorAll("nav summary")) toggle.ariaLabel = "Pages below";
    for (const list of document.querySelectorAll(".citation-list")) list.removeAttribute("role");
});
