// The theme's buttons that expand a section of the sidebar have no name for screen readers.
document.querySelectorAll("summary:has(.toctree-toggle)").forEach((button) => button.setAttribute("aria-label", "Expand section"));
