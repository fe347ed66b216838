// What the theme leaves out for those who read without a mouse, or listen.
function reachable() { // by keyboard, what can be pulled to the side
  for (const part of document.querySelectorAll("pre, table.docutils, .diagram"))
    if (part.scrollWidth > part.clientWidth) part.tabIndex = 0;
}
document.addEventListener("DOMContentLoaded", () => {
  for (const head of document.querySelectorAll(".caption[role=heading]")) head.ariaLevel = 2;
  document.querySelector(".sidebar-drawer")?.setAttribute("aria-label", "All pages");
  document.querySelector(".toc-drawer")?.setAttribute("aria-label", "On this page");
  reachable();
});
window.addEventListener("resize", reachable);
