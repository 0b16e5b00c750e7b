"use strict";
(() => {
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

  // The marked line: null until somebody asks for one.
  let marked = null;

  // ---------------------------------------------------------------- viewer

  const MOST_ZOOM = 24;
  const GRAB = 24; // CSS px beside the divider that still take hold of it
  const stage = find("stage");
  const canvas = find("canvas");
  const context = canvas.getContext("2d");
  const view = { x: width / 2, y: height / 2, zoom: 1, fit: true };
  let split = 0.5;
  let pending = false;
  const bankPictures = new Map();

  const sideBySide = () => find("layout").value === "side";
  const paneCount = () => (sideBySide() ? 2 : 1);
  const paneSize = () => [stage.clientWidth / paneCount(), stage.clientHeight];
  const fitZoom = () => Math.min(paneSize()[0] / width, paneSize()[1] / height);

  function changed() {
    if (!pending) {
      pending = true;
      requestAnimationFrame(() => {
        pending = false;
        draw();
      });
    }
  }

  function settle() {
    const [w, h] = paneSize();
    const fit = fitZoom();
    view.zoom = view.fit ? fit : clamp(view.zoom, Math.min(fit, 1 / devicePixelRatio), MOST_ZOOM);
    const keep = (place, size, room) =>
      size * view.zoom <= room ? size / 2 : clamp(place, room / 2 / view.zoom, size - room / 2 / view.zoom);
    view.x = keep(view.x, width, w);
    view.y = keep(view.y, height, h);
    stage.classList.toggle("zoomed", view.zoom > fit * 1.001);
    // One picture px on one px of the screen is 100 %.
    find("zoom").value = `${Math.round(100 * view.zoom * devicePixelRatio)} %`;
    find("divider").hidden = sideBySide();
    changed();
  }

  function resize() {
    const w = stage.clientWidth;
    stage.style.height = `${Math.round(clamp((w / paneCount() / width) * height, 160, innerHeight * 0.74))}px`;
    canvas.width = Math.round(w * devicePixelRatio);
    canvas.height = Math.round(stage.clientHeight * devicePixelRatio);
    settle();
    // A new size empties the canvas, which must not be seen.
    draw();
  }

  // Left edge of the pane that a place on the stage lies in.
  const paneLeft = (x) => (sideBySide() && x >= paneSize()[0] ? paneSize()[0] : 0);

  function toPicture(x, y) {
    const [w, h] = paneSize();
    return [view.x + (x - paneLeft(x) - w / 2) / view.zoom, view.y + (y - h / 2) / view.zoom];
  }

  function zoomBy(factor, x = paneSize()[0] / 2, y = paneSize()[1] / 2) {
    const [px, py] = toPicture(x, y);
    view.fit = false;
    view.zoom = clamp(view.zoom * factor, Math.min(fitZoom(), 1 / devicePixelRatio), MOST_ZOOM);
    const [w, h] = paneSize();
    view.x = px - (x - paneLeft(x) - w / 2) / view.zoom;
    view.y = py - (y - h / 2) / view.zoom;
    view.fit = factor < 1 && view.zoom <= fitZoom();
    settle();
  }

  function zoomTo(zoom) {
    view.fit = zoom === null;
    view.zoom = zoom ?? view.zoom;
    settle();
  }

  function pan(dx, dy) {
    view.x -= dx / view.zoom;
    view.y -= dy / view.zoom;
    settle();
  }

  function setSplit(share) {
    split = clamp(share, 0, 1);
    find("divider").value = (100 * split).toFixed(1);
    changed();
  }

  function draw() {
    const [w, h] = paneSize();
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.clearRect(0, 0, stage.clientWidth, h);
    const cut = split * w;
    const panes = sideBySide()
      ? [[find("left").value, 0, 0, w], [find("right").value, w, w, w]]
      : [[find("left").value, 0, 0, cut], [find("right").value, 0, cut, w - cut]];
    for (const [label, origin, from, room] of panes) {
      context.save();
      context.beginPath();
      context.rect(from, 0, room, h);
      context.clip();
      context.translate(origin + w / 2 - view.x * view.zoom, h / 2 - view.y * view.zoom);
      context.scale(view.zoom, view.zoom);
      drawPicture(sources.get(label));
      drawBank();
      drawMarkedLine();
      context.restore();
    }
    drawDivider(sideBySide() ? w : cut, h);
    find("tag-left").textContent = find("left").value;
    find("tag-right").textContent = find("right").value;
  }

  function drawPicture(image) {
    // Enlarged pixels stay recognisable; reduced ones are averaged well.
    context.imageSmoothingEnabled = (view.zoom * devicePixelRatio) / data.scale < 3;
    context.imageSmoothingQuality = "high";
    context.drawImage(image, 0, 0, width, height);
  }

  function drawBank() {
    const label = find("bank").value;
    const tinted = bankPictures.get(label);
    if (!tinted) return;
    const bank = data.banks[label];
    const [kw, kh] = bank.kernel;
    const { magnified, down, across } = arrangement(bank);
    context.fillStyle = magnified === 1 ? "rgb(0 0 0 / 25%)" : "rgb(0 0 0 / 50%)";
    context.fillRect(0, 0, width, height);
    context.imageSmoothingEnabled = true;
    context.strokeStyle = "#5eceff";
    context.lineWidth = 1 / view.zoom;
    const arm = 4 / view.zoom;
    for (const row of down) {
      for (const col of across) {
        // Pixel centres are at whole numbers, the canvas counts from a pixel's corner.
        const y = bank.rows[row] + 0.5;
        const x = bank.cols[col] + 0.5;
        const [w, h] = [kw * magnified, kh * magnified];
        context.drawImage(tinted, col * kw, row * kh, kw, kh, x - w / 2, y - h / 2, w, h);
        context.beginPath();
        context.moveTo(x - arm, y);
        context.lineTo(x + arm, y);
        context.moveTo(x, y - arm);
        context.lineTo(x, y + arm);
        context.stroke();
      }
    }
  }

  // Which kernels have room, and how much larger than life they are drawn.
  function arrangement(bank) {
    const gap = (places, whole) =>
      places.length > 1 ? Math.min(...places.slice(1).map((place, i) => place - places[i])) : whole;
    const chosen = (places, side) => {
      const wanted = places.length > 1 ? Math.ceil((1.5 * side) / gap(places, 0)) : 1;
      const every = clamp(wanted, 1, Math.max(1, Math.floor(places.length / 4)));
      return places.map((_, i) => i).filter((i) => i % every === Math.floor(every / 2));
    };
    const [kw, kh] = bank.kernel;
    const down = chosen(bank.rows, kh);
    const across = chosen(bank.cols, kw);
    const tall = gap(down.map((i) => bank.rows[i]), height);
    const wide = gap(across.map((i) => bank.cols[i]), width);
    const magnified = find("true-size").checked ? 1 : Math.min((0.94 * tall) / kh, (0.94 * wide) / kw, 12);
    return { magnified, down, across };
  }

  function noteBank() {
    const bank = data.banks[find("bank").value];
    if (!bank) return "";
    const { magnified, down, across } = arrangement(bank);
    const [rows, cols] = bank.of;
    const shown = `${down.length * across.length} of ${rows * cols} PSFs shown`;
    const size = magnified === 1 ? "at true size" : `${magnified.toFixed(1)} times as large as in the picture`;
    return `${rows * cols === 1 ? "the PSF" : shown}, ${size}`;
  }

  // Grey kernels become a glow from red over orange to white.
  function tint(image) {
    const surface = document.createElement("canvas");
    surface.width = image.naturalWidth;
    surface.height = image.naturalHeight;
    const brush = surface.getContext("2d");
    brush.drawImage(image, 0, 0);
    const pixels = brush.getImageData(0, 0, surface.width, surface.height);
    for (let i = 0; i < pixels.data.length; i += 4) {
      const glow = pixels.data[i] / 255;
      pixels.data[i] = 255 * Math.min(1, 0.75 + glow);
      pixels.data[i + 1] = 255 * (0.25 + 0.75 * glow ** 1.5);
      pixels.data[i + 2] = 255 * glow ** 4;
      pixels.data[i + 3] = 255 * Math.min(1, 1.6 * glow);
    }
    brush.putImageData(pixels, 0, 0);
    return surface;
  }

  function drawMarkedLine() {
    if (marked === null) return;
    context.strokeStyle = "#5eceff";
    context.lineWidth = 1.5 / view.zoom;
    context.beginPath();
    if (motion.axis === "y") {
      context.moveTo(0, marked + 0.5);
      context.lineTo(width, marked + 0.5);
    } else {
      context.moveTo(marked + 0.5, 0);
      context.lineTo(marked + 0.5, height);
    }
    context.stroke();
  }

  function drawDivider(x, h) {
    context.fillStyle = "#fff";
    context.strokeStyle = "rgb(0 0 0 / 60%)";
    context.lineWidth = 1;
    context.strokeRect(x - 1.5, -1, 3, h + 2);
    context.fillRect(x - 1, 0, 2, h);
    if (sideBySide()) return;
    context.beginPath();
    context.arc(x, h / 2, 13, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
    context.fillStyle = "#1d2126";
    for (const side of [-1, 1]) {
      context.beginPath();
      context.moveTo(x + side * 9, h / 2);
      context.lineTo(x + side * 3.5, h / 2 - 5);
      context.lineTo(x + side * 3.5, h / 2 + 5);
      context.fill();
    }
  }

  // ---------------------------------------------------------------- viewer: hands

  const pointers = new Map();
  let hold = null;

  const place = (event) => {
    const box = stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };

  function pointTo(x, y) {
    const [px, py] = toPicture(x, y).map(Math.floor);
    const inside = px >= 0 && py >= 0 && px < width && py < height;
    const line = motion.axis === "y" ? py : px;
    find("pointer").textContent = inside ? `x ${px}, y ${py}: ${lineWord} ${line} ${windowText(line)}` : "";
  }

  stage.addEventListener("pointerdown", (event) => {
    if (event.button > 0) return;
    stage.setPointerCapture(event.pointerId);
    const [x, y] = place(event);
    pointers.set(event.pointerId, [x, y]);
    const near = Math.abs(x - split * stage.clientWidth) < GRAB;
    const whole = !stage.classList.contains("zoomed");
    hold = pointers.size > 1 ? "pinch" : !sideBySide() && (near || whole) ? "divider" : "pan";
    if (hold === "divider") setSplit(x / stage.clientWidth);
    stage.classList.toggle("held", hold === "pan");
  });

  stage.addEventListener("pointermove", (event) => {
    const [x, y] = place(event);
    pointTo(x, y);
    const before = pointers.get(event.pointerId);
    if (!before) return;
    if (hold === "pinch") {
      const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
      if (other) {
        const apart = ([ax, ay]) => Math.max(Math.hypot(ax - other[0], ay - other[1]), 1);
        const middle = [(x + other[0]) / 2, (y + other[1]) / 2];
        zoomBy(apart([x, y]) / apart(before), ...middle);
        pan((x - before[0]) / 2, (y - before[1]) / 2);
      }
    } else if (hold === "divider") {
      setSplit(x / stage.clientWidth);
    } else {
      pan(x - before[0], y - before[1]);
    }
    pointers.set(event.pointerId, [x, y]);
  });

  for (const kind of ["pointerup", "pointercancel"]) {
    stage.addEventListener(kind, (event) => {
      pointers.delete(event.pointerId);
      // The finger that stays after a pinch pans.
      hold = pointers.size ? "pan" : null;
      stage.classList.toggle("held", hold === "pan");
    });
  }

  stage.addEventListener("dblclick", (event) => zoomBy(2, ...place(event)));
  stage.addEventListener(
    "wheel",
    (event) => {
      // A page must scroll under the wheel; trackpads report a pinch as Ctrl and wheel.
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      zoomBy(Math.exp(clamp(-event.deltaY, -60, 60) / 150), ...place(event));
    },
    { passive: false },
  );

  const swap = () => {
    [find("left").value, find("right").value] = [find("right").value, find("left").value];
    changed();
  };
  const chooseBank = () => {
    find("bank-note").textContent = noteBank();
    changed();
  };
  const nextBank = () => {
    const choice = find("bank");
    choice.selectedIndex = (choice.selectedIndex + 1) % choice.options.length;
    chooseBank();
  };
  const step = () => 0.12 * Math.min(...paneSize());
  const KEYS = {
    "+": () => zoomBy(1.5),
    "=": () => zoomBy(1.5),
    "-": () => zoomBy(1 / 1.5),
    0: () => zoomTo(null),
    1: () => zoomTo(1 / devicePixelRatio),
    ArrowLeft: () => pan(step(), 0),
    ArrowRight: () => pan(-step(), 0),
    ArrowUp: () => pan(0, step()),
    ArrowDown: () => pan(0, -step()),
    ",": () => setSplit(split - 0.02),
    ".": () => setSplit(split + 0.02),
    x: swap,
    p: nextBank,
  };
  stage.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !Object.hasOwn(KEYS, event.key)) return;
    event.preventDefault();
    KEYS[event.key]();
  });

  async function startViewer() {
    const option = (label) => new Option(label, label);
    for (const id of ["left", "right"]) {
      find(id).append(...labels.map(option));
      find(id).addEventListener("change", changed);
    }
    find("left").value = labels[0];
    find("right").value = labels.includes("banded") ? "banded" : labels[1];
    find("bank").append(...Object.keys(data.banks).map(option));
    find("bank").addEventListener("change", chooseBank);
    find("true-size").addEventListener("change", chooseBank);
    find("layout").addEventListener("change", resize);
    find("divider").addEventListener("input", (event) => setSplit(event.target.value / 100));
    find("swap").addEventListener("click", swap);
    find("zoom-in").addEventListener("click", KEYS["+"]);
    find("zoom-out").addEventListener("click", KEYS["-"]);
    find("fit").addEventListener("click", KEYS[0]);
    find("one").addEventListener("click", KEYS[1]);
    for (const [label, bank] of Object.entries(data.banks)) {
      const image = new Image();
      image.src = bank.atlas;
      await image.decode();
      bankPictures.set(label, tint(image));
    }
    await Promise.all([...sources.values()].map((image) => image.decode()));
    find("sources").hidden = true;
    find("viewer").hidden = false;
    new ResizeObserver(resize).observe(stage.parentElement);
    addEventListener("resize", resize);
    resize();
  }

  // ---------------------------------------------------------------- plots

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
    const found = [];
    for (let i = Math.ceil(low / unit - 1e-9); i * unit <= high + 1e-9 * unit; i++) found.push(+(i * unit).toPrecision(12));
    return found;
  }

  const scale = (from, to) => (value) => to[0] + ((value - from[0]) * (to[1] - to[0])) / (from[1] - from[0]);
  const path = (points) => points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`).join("");

  // Series differ by dashes or marks too, not by colour alone.
  const DASHES = ["none", "7 3", "2 3"];
  const MARKS = [
    (x, y) => `M${x - 4} ${y}a4 4 0 1 0 8 0a4 4 0 1 0 -8 0`,
    (x, y) => `M${x - 4} ${y - 4}h8v8h-8Z`,
    (x, y) => `M${x} ${y - 5}L${x + 5} ${y + 4}H${x - 5}Z`,
    (x, y) => `M${x} ${y - 5.5}L${x + 5.5} ${y}L${x} ${y + 5.5}L${x - 5.5} ${y}Z`,
    (x, y) => `M${x - 5} ${y + 3.5}L${x} ${y - 5}L${x + 5} ${y + 3.5}L${x} ${y + 1}Z`,
  ];

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
    const handle = svg("rect", { class: "zoomable", x: LEFT, y: WINDOWS[0], width: wide - 10 - LEFT, height: WINDOWS[1] - WINDOWS[0], fill: "transparent" });
    drawing.append(handle);
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
    find("line-note").value = `choose a ${lineWord} to see its window here and the ${lineWord} in the pictures`;
    const holder = find("rates");
    const follow = (event) => {
      if (event.buttons && event.target.classList.contains("zoomable")) {
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

  const SERIES = 5;

  function drawBands(holder, title, figures) {
    const wide = Math.max(holder.clientWidth, 240);
    const [top, bottom] = [28, 260];
    const drawing = svg("svg", { width: wide, height: bottom + 40 });
    const values = Object.values(figures).flat().filter((value) => value !== null);
    const domain = [0, 1.08 * values.reduce((a, b) => Math.max(a, b), 1e-3)];
    const x = scale(domain, [LEFT, wide - 12]);
    const y = scale([bands.edges[0], bands.edges.at(-1)], [top, bottom]);
    axisBeside(drawing, y, ticks(bands.edges[0], bands.edges.at(-1), 5), LEFT, wide - 12);
    axisBelow(drawing, x, domain, bottom, top, title);
    drawing.append(svg("text", { class: "title", x: LEFT, y: 14 }, `${title}, by ${lineWord}`));
    Object.values(figures).forEach((series, i) => {
      const points = series.map((value, k) => [value, y((bands.edges[k] + bands.edges[k + 1]) / 2)]);
      const known = points.filter(([value]) => value !== null).map(([value, place]) => [x(value), place]);
      drawing.append(svg("path", { class: `s${i % SERIES}`, d: path(known) }));
      for (const point of known) drawing.append(svg("path", { class: `s${i % SERIES} mark`, d: MARKS[i % SERIES](...point) }));
    });
    holder.replaceChildren(drawing);
  }

  function startBands() {
    find("bands").hidden = false;
    addLegend(find("bands-legend"), Object.keys(bands.sharpness), (i) => [
      svg("path", { class: `s${i % SERIES}`, d: "M0 7H30" }),
      svg("path", { class: `s${i % SERIES} mark`, d: MARKS[i % SERIES](15, 7) }),
    ]);
    for (const [title, figures] of [["sharpness, × the input's", bands.sharpness], ["ringing, %", bands.ringing]]) {
      const holder = document.createElement("div");
      holder.className = "plot";
      holder.setAttribute("role", "img");
      holder.setAttribute("aria-label", `Chart of ${title} by ${lineWord}; the figures follow as tables`);
      find("bands-charts").append(holder);
      new ResizeObserver(() => drawBands(holder, title, figures)).observe(holder);
    }
  }

  startMotion();
  startBands();
  startViewer();
})();
