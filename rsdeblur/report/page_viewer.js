// Helpers of all parts of a page, and the content that it shows. The files are joined into one module: this one, then
// the plots of the report or the controls of the app.

const find = (id) => document.getElementById(id);
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
let data, width, height, motion, lineWord, sources, labels;

function load(content) {
  data = content;
  [width, height] = data.size;
  ({ motion } = data);
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

// Viewer: any two pictures, with a divider or side by side, and PSFs drawn over them.

const MOST_ZOOM = 24;
const GRAB = 24; // CSS px beside the divider where a press still moves it
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
  // 100 % is one picture pixel per screen pixel.
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
  // A new size clears the canvas; drawing at once keeps it from flashing.
  draw();
}

// Left edge of the pane that contains a place on the stage.
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

// Which kernels have room, and by what factor they are magnified.
function arrangement(bank) {
  const gap = (places, whole) =>
    places.length > 1 ? Math.min(...places.slice(1).map((place, i) => place - places[i])) : whole;
  const chosen = (places, side) => {
    const stride = places.length > 1 ? Math.ceil((1.5 * side) / gap(places, 0)) : 1;
    const every = clamp(stride, 1, Math.max(1, Math.floor(places.length / 4)));
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

// Mouse, fingers and keys.

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
    // The wheel alone must scroll the page; trackpads report a pinch as Ctrl and wheel.
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
  find("right").value = data.best ?? labels[1];
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
  // A large picture opens at 1:1: reduced, it looks like the input.
  if (data.isWhole && fitZoom() * devicePixelRatio < 1) zoomTo(1 / devicePixelRatio);
}

if (data) startViewer();
