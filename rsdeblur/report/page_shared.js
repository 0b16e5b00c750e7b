// Helpers of all parts of the page. The files are joined into one module in the order shared, viewer, plots.

const data = JSON.parse(document.getElementById("data").textContent);
const find = (id) => document.getElementById(id);
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
const [width, height] = data.size;
const { motion, bands } = data;
const lineWord = motion.axis === "y" ? "row" : "column";
const sources = new Map([...document.querySelectorAll("#sources img")].map((image) => [image.dataset.label, image]));
const labels = [...sources.keys()];

// Time in ms at which a line opens.
const opensAt = (line) =>
  motion.opens[0] + (motion.lines > 1 ? ((motion.opens[1] - motion.opens[0]) * line) / (motion.lines - 1) : 0);
const windowText = (line) => `exposed ${opensAt(line).toFixed(2)} to ${(opensAt(line) + motion.duration).toFixed(2)} ms`;

// The marked line: null until the user chooses one.
let marked = null;
