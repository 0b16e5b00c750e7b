// Helpers of all parts of a page, and the content that it shows. The files are joined into one module: this one, the
// viewer, then the plots of the report or the controls of the app.

const find = (id) => document.getElementById(id);
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
let data, width, height, motion, bands, lineWord, sources, labels;

function load(content) {
  data = content;
  [width, height] = data.size;
  ({ motion, bands } = data);
  lineWord = motion.axis === "y" ? "row" : "column";
  sources = new Map([...document.querySelectorAll("#sources img")].map((image) => [image.dataset.label, image]));
  labels = [...sources.keys()];
}

// The report contains its data; the app receives them.
const embedded = find("data");
if (embedded) load(JSON.parse(embedded.textContent));

// Time in ms at which a line opens.
const opensAt = (line) =>
  motion.opens[0] + (motion.lines > 1 ? ((motion.opens[1] - motion.opens[0]) * line) / (motion.lines - 1) : 0);
const windowText = (line) => `exposed ${opensAt(line).toFixed(2)} to ${(opensAt(line) + motion.duration).toFixed(2)} ms`;

// The marked line: null until the user chooses one.
let marked = null;
