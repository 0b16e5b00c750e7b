// Plot of the motion.

function svg(name, attributes, text) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

// Round numbers that divide a range into about `count` parts.
function ticks(low, high, count) {
  const raw = Math.max(high - low, 1e-12) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const unit = [1, 2, 5, 10].find((factor) => factor * power >= raw) * power;
  const values = [];
  for (let i = Math.ceil(low / unit - 1e-9); i * unit <= high + 1e-9 * unit; i++) values.push(+(i * unit).toPrecision(12));
  return values;
}

const scale = (from, to) => (value) => to[0] + ((value - from[0]) * (to[1] - to[0])) / (from[1] - from[0]);
const path = (points) => points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`).join("");

// Series differ in dashes, not only in colour.
const DASHES = ["none", "7 3", "2 3"];

function addLegend(list, names, draw) {
  names.forEach((name, i) => {
    const item = document.createElement("li");
    const sample = svg("svg", { width: 30, height: 14, "aria-hidden": "true" });
    sample.append(...draw(i));
    item.append(sample, name);
    list.append(item);
  });
}

function axisBelow(drawing, x, domain, y, top, title) {
  for (const tick of ticks(...domain, clamp((x(domain[1]) - x(domain[0])) / 60, 3, 10))) {
    drawing.append(svg("line", { class: "grid", x1: x(tick), x2: x(tick), y1: top, y2: y }));
    drawing.append(svg("text", { x: x(tick), y: y + 16, "text-anchor": "middle" }, tick));
  }
  drawing.append(svg("text", { x: x(domain[1]), y: y + 33, "text-anchor": "end" }, title));
}

function axisBeside(drawing, y, values, left, right) {
  for (const tick of values) {
    drawing.append(svg("line", { class: "grid", x1: left, x2: right, y1: y(tick), y2: y(tick) }));
    drawing.append(svg("text", { x: left - 7, y: y(tick) + 4, "text-anchor": "end" }, tick));
  }
}

const LEFT = 52;
const RATES = [24, 214];
const WINDOWS = [254, 370];

function drawMotion() {
  const holder = find("rates");
  const wide = Math.max(holder.clientWidth, 260);
  const drawing = svg("svg", { width: wide, height: WINDOWS[1] + 40 });
  const end = Math.max(...motion.opens) + motion.duration;
  const times = [motion.t[0] ?? 0, motion.t.at(-1) ?? end];
  const domain = [Math.min(times[0], 0), Math.max(times[1], end)];
  const x = scale(domain, [LEFT, wide - 10]);
  const all = motion.rates.flat();
  const least = all.reduce((a, b) => Math.min(a, b), 0);
  const most = all.reduce((a, b) => Math.max(a, b), 0);
  const margin = 0.06 * Math.max(most - least, 1e-3);
  const rate = scale([least - margin, most + margin], [RATES[1], RATES[0]]);
  const line = scale([0, Math.max(motion.lines - 1, 1)], WINDOWS);

  drawing.append(svg("rect", { class: "exposed", x: x(0), y: RATES[0], width: x(end) - x(0), height: RATES[1] - RATES[0] }));
  axisBeside(drawing, rate, ticks(least - margin, most + margin, 5), LEFT, wide - 10);
  axisBeside(drawing, line, ticks(0, motion.lines - 1, 4), LEFT, wide - 10);
  axisBelow(drawing, x, domain, WINDOWS[1], RATES[0], "time since the first line opens, ms");
  drawing.append(svg("text", { class: "title", x: LEFT, y: 14 }, "rate, rad/s"));
  drawing.append(svg("text", { class: "title", x: LEFT, y: WINDOWS[0] - 10 }, `exposed ${lineWord}s`));
  motion.rates.forEach((values, i) => {
    const points = values.map((value, k) => [x(motion.t[k]), rate(value)]);
    drawing.append(svg("path", { class: `s${i + 1}`, "stroke-dasharray": DASHES[i], d: path(points) }));
  });
  const last = motion.lines - 1;
  const corners = [[0, 0], [0, motion.duration], [last, motion.duration], [last, 0]];
  drawing.append(svg("path", { class: "windows", d: `${path(corners.map(([n, dt]) => [x(opensAt(n) + dt), line(n)]))}Z` }));
  if (marked !== null) {
    const [open, close] = [x(opensAt(marked)), x(opensAt(marked) + motion.duration)];
    drawing.append(svg("rect", { class: "chosen", x: open, y: RATES[0], width: close - open, height: RATES[1] - RATES[0] }));
    drawing.append(svg("line", { class: "chosen-line", x1: open, x2: close, y1: line(marked), y2: line(marked) }));
  }
  const [top, bottom] = WINDOWS;
  const field = { x: LEFT, y: top, width: wide - 10 - LEFT, height: bottom - top, fill: "transparent" };
  drawing.append(svg("rect", { class: "touchable", ...field }));
  holder.replaceChildren(drawing);
}

function mark(line) {
  marked = clamp(Math.round(line), 0, motion.lines - 1);
  find("line").value = marked;
  find("line-note").value = `${lineWord} ${marked}: ${windowText(marked)}`;
  drawMotion();
  changed();
}

function startMotion() {
  find("motion").hidden = false;
  find("line").max = motion.lines - 1;
  find("line-name").textContent = lineWord === "row" ? "Row" : "Column";
  find("line").addEventListener("input", (event) => mark(+event.target.value));
  find("line-note").value = `choose a ${lineWord} to mark it in the pictures and to see when it was exposed`;
  const holder = find("rates");
  const follow = (event) => {
    if (event.buttons && event.target.classList.contains("touchable")) {
      const y = event.clientY - holder.getBoundingClientRect().top;
      mark(scale(WINDOWS, [0, motion.lines - 1])(y));
    }
  };
  holder.addEventListener("pointerdown", follow);
  holder.addEventListener("pointermove", follow);
  addLegend(find("rates-legend"), ["about x", "about y", "about z"], (i) => [
    svg("path", { class: `s${i + 1}`, "stroke-dasharray": DASHES[i], d: "M0 7H30" }),
  ]);
  new ResizeObserver(drawMotion).observe(holder);
}

startMotion();
