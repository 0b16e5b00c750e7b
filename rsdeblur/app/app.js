// Controls of the app: the form is sent whole with every request; the server answers with the crop and the command.

const CROP = [512, 384]; // px; solved again in a fraction of a second
const REST = 350; // ms without a change before the crop is solved at full size and checked
const QUICK = 0.2; // s for a draft; while a slider moves, slower crops are solved at a smaller size
const SCALES = [1, 0.5, 0.35, 0.25];
const SLIDERS = ["power", "time_offset", "readout_time", "focal_length", "softness"];
let opened = null; // the answer to "open"
let box = null; // left, top, width, height of the crop
let running = false;
let next = null; // the request that waits; a later one replaces it
let resting = 0;
let draftSize = 0; // index of the size of drafts in SCALES; the first answer must contain the input too
let started = false;
let isExample = false;
let complainer = ""; // what the message is about

async function ask(action, body, kind = "application/json") {
  const answer = await fetch(action, { method: "POST", headers: { "Content-Type": kind }, body }).catch(() => {
    throw new Error("The app was stopped. Start it again: rsdeblur app");
  });
  if (answer.headers.get("Content-Type") !== "application/json") throw new Error(await answer.text());
  const content = await answer.json();
  if (!answer.ok) throw new Error(content.error);
  return content;
}

// A crop that is solved takes back the complaint about an earlier one only.
function complain(error, by = "") {
  if (!error && by !== "" && by !== complainer) return;
  complainer = by;
  find("error").textContent = error ? error.message : "";
  find("error").hidden = !error;
  if (error) busy("");
}

function busy(text) {
  find("busy").textContent = text;
  find("busy").hidden = !text;
}

function remark(notes) {
  find("notes").replaceChildren(
    ...notes.map((note) => Object.assign(document.createElement("li"), { textContent: note })),
  );
  find("notes").hidden = !notes.length;
}

// The form as the server expects it: texts by name. A slider that was not moved sets nothing, nor does any for a photo
// that is not open yet.
function form(sliders = opened !== null) {
  const values = {};
  for (const input of document.querySelectorAll("#open-form [name]")) values[input.name] = valueOf(input);
  for (const name of ["mode", "prior"]) values[name] = find("controls").elements[name].value;
  values.output = find("output").value;
  if (!sliders) return values;
  Object.assign(values, opened.moment);
  values.moved = {};
  values.power = Number(find("power").value);
  const moved = (name) => find(name).value !== find(name).defaultValue;
  if (moved("time_offset")) values.moved.time_offset = `${offset().toFixed(2)}ms`;
  if (moved("readout_time")) values.moved.readout_time = `${find("readout_time").value}ms`;
  if (moved("focal_length")) values.moved.focal_length = focal().toFixed(1);
  if (moved("softness")) values.moved.softness = find("softness").value;
  return values;
}

// The value of a field; one that shows the name of a file that was sent means its place.
const valueOf = (input) => (input.value && input.value === input.dataset.sent ? input.dataset.place : input.value);

function put(input, path) {
  input.value = input.dataset.sent = lastPart(path);
  input.dataset.place = path;
}

const offset = () => 1e3 * opened.time_offset + Number(find("time_offset").value);
const focal = () => opened.focal_length * 2 ** Number(find("focal_length").value);

function showValues(strength) {
  find("time_offset-value").value = `${offset().toFixed(1)} ms`;
  find("readout_time-value").value = `${Number(find("readout_time").value).toFixed(1)} ms`;
  find("focal_length-value").value = `${focal().toFixed(0)} px`;
  find("softness-value").value = `${Number(find("softness").value).toFixed(2)} px`;
  if (strength) find("power-value").value = `${strength.value.toPrecision(3)}${strength.power ? "" : " (auto)"}`;
}

function solve(draft) {
  next = { scale: draft ? SCALES[draftSize] : 1, check: !draft };
  if (!running) work();
}

async function work() {
  running = true;
  while (next) {
    const request = next;
    next = null;
    find("state").textContent = "solving…";
    try {
      const answer = await ask("solve", JSON.stringify({ ...form(), ...request, box }));
      complain(null, "solve");
      await show(answer, request);
    } catch (error) {
      complain(error, "solve");
      find("state").textContent = "";
    }
  }
  running = false;
}

// Drafts get the largest size that this machine solves quickly; other sizes take other times than their areas.
function adapt({ scale }, { seconds }) {
  const at = SCALES.indexOf(scale);
  if (seconds > QUICK) draftSize = Math.max(draftSize, Math.min(at + 1, SCALES.length - 1));
  else if (at <= draftSize && seconds < QUICK / 3) draftSize = Math.max(at - 1, 0);
}

async function show(answer, request) {
  const draft = request.scale < 1;
  adapt(request, answer);
  const fresh = !started || answer.size.join() !== data.size.join();
  const banks = draft && data ? data.banks : answer.banks;
  for (const [label, uri] of Object.entries(answer.pictures)) {
    const image = document.querySelector(`#sources [data-label="${label}"]`);
    image.src = uri;
    await image.decode();
  }
  load({ size: answer.size, scale: answer.scale, banks, motion: answer.motion });
  box = answer.box;
  if (!started) {
    started = true;
    Object.assign(view, { x: width / 2, y: height / 2 });
    await startViewer();
  } else {
    for (const [label, bank] of Object.entries(answer.banks)) {
      const image = new Image();
      image.src = bank.atlas;
      await image.decode();
      bankPictures.set(label, tint(image));
    }
    if (fresh) resize();
    chooseBank();
  }
  showFrame();
  showValues(answer.strength);
  find("line").value = answer.command;
  find("bare").hidden = !answer.bare;
  find("bare").textContent = isExample
    ? "rsdeblur demo --size 640x480 writes these files into the folder demo; run the command there."
    : "Run the command in the folder of these files, which a browser does not reveal.";
  find("state").textContent = `${draft ? `draft at ${Math.round(100 * request.scale)} %, ` : ""}${answer.seconds.toFixed(2)} s`;
  if (request.check) showCheck(answer);
}

function showCheck(answer) {
  const { check } = answer;
  find("verdict").textContent = check ? `Check of this part: ${check.verdict}` : "";
  find("verdict").className = check ? `verdict-${check.verdict.replace(" ", "-")}` : "";
  find("reasons").textContent = check ? check.reasons.join(" ") : "";
  remark(answer.notes);
}

function changedBySlider() {
  showValues(null);
  if (Number(find("power").value)) find("power-value").value = `× ${(10 ** Number(find("power").value)).toPrecision(2)}`;
  solve(true);
  clearTimeout(resting);
  resting = setTimeout(() => solve(false), REST);
}

// Place of the crop.

function showFrame() {
  const [w, h] = opened.size;
  const share = (part, whole) => `${(100 * part) / whole}%`;
  Object.assign(find("frame").style, {
    left: share(box[0], w), top: share(box[1], h), width: share(box[2], w), height: share(box[3], h),
  });
}

function moveCrop(x, y) {
  const [w, h] = opened.size;
  const [bw, bh] = CROP.map((side, i) => Math.min(side, opened.size[i]));
  box = [Math.round(clamp(x - bw / 2, 0, w - bw)), Math.round(clamp(y - bh / 2, 0, h - bh)), bw, bh];
  showFrame();
  changedBySlider();
}

const crop = () => [box[0] + box[2] / 2, box[1] + box[3] / 2];
const pointAt = (event) => {
  const area = find("overview").getBoundingClientRect();
  moveCrop(((event.clientX - area.left) / area.width) * opened.size[0], ((event.clientY - area.top) / area.height) * opened.size[1]);
};
find("overview").addEventListener("pointerdown", (event) => {
  find("overview").setPointerCapture(event.pointerId);
  pointAt(event);
});
find("overview").addEventListener("pointermove", (event) => event.buttons && pointAt(event));
find("overview").addEventListener("keydown", (event) => {
  const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  if (!way) return;
  event.preventDefault();
  const [x, y] = crop();
  moveCrop(x + 0.25 * box[2] * way[0], y + 0.25 * box[3] * way[1]);
});

// Files.

async function open() {
  busy("Reading the photo and its log. Finding the moment of a photo with nothing but EXIF takes a while…");
  try {
    opened = await ask("open", JSON.stringify(form(false)));
  } catch (error) {
    complain(error);
    find("options").open = true;
    return;
  }
  complain(null);
  busy("");
  remark(opened.notes);
  find("title").textContent = opened.name;
  document.title = `${opened.name} · rsdeblur`;
  find("whole").src = opened.overview;
  find("output").value = opened.output;
  const readout = find("readout_time");
  readout.max = Math.max(60, 2e3 * opened.readout_time);
  // A value between two steps would be rounded, and then count as moved.
  readout.step = "any";
  readout.defaultValue = 1e3 * opened.readout_time;
  resetSliders();
  showChips();
  for (const id of ["saved", "saving", "start"]) find(id).hidden = true;
  for (const id of ["work", "found"]) find(id).hidden = false;
  find("options").open = false;
  find("work").focus({ preventScroll: true });
  moveCrop(opened.size[0] / 2, opened.size[1] / 2);
}

const lastPart = (path) => path.split(/[\\/]/).pop();

// What the files contain; each chip opens the field that replaces it.
function showChips() {
  const isFromExif = !find("camera").value;
  const chips = [
    ["photo", "Size", opened.size.join(" × ")],
    ["gyro", "Log", lastPart(find("gyro").value)],
    ["focal", "Focal length", `${opened.focal_length.toFixed(0)} px`, isFromExif && !find("focal").value],
    ["readout", "Readout", `${(1e3 * opened.readout_time).toPrecision(3)} ms`, opened.readout_is_guess],
    ["start_at", "Start", `${opened.start.toFixed(3)} s`],
    ["duration", "Exposure", `${(1e3 * opened.duration).toPrecision(3)} ms`],
    ["orientation", "Axes", opened.axes || "of the camera file", isFromExif],
  ];
  find("chips").replaceChildren(
    ...chips.map(([field, label, value, guess]) => {
      const chip = Object.assign(document.createElement("button"), { type: "button", className: guess ? "guess" : "" });
      chip.append(`${label} `, Object.assign(document.createElement("strong"), { textContent: value }), guess ? " (a guess)" : "");
      chip.addEventListener("click", () => {
        find("options").open = true;
        find(field).focus();
      });
      return chip;
    }),
  );
}

const resetSliders = () => SLIDERS.forEach((name) => (find(name).value = find(name).defaultValue));

function fill(values) {
  for (const input of document.querySelectorAll("#open-form [name]")) input.value = values[input.name] ?? "";
  showChosen();
}

function showChosen() {
  const files = { photo: "Photo", gyro: "Gyro log", camera: "Camera", capture: "Exposures" };
  const items = Object.entries(files).flatMap(([name, label]) => {
    if (!find(name).value) return [];
    const item = document.createElement("li");
    item.append(`${label} `, Object.assign(document.createElement("strong"), { textContent: lastPart(find(name).value) }));
    return [item];
  });
  find("chosen").replaceChildren(...items);
}

// Open what is complete; say what is missing, and a hint.
async function openIfComplete(hint = "") {
  showChosen();
  const missing = [["photo", "a photo"], ["gyro", "its gyro log"]].filter(([name]) => !find(name).value).map(([, text]) => text);
  if (missing.length === 0) await open();
  else busy(missing.length === 1 ? `Now add ${missing[0]}.${hint}` : "");
}

async function receive(files, field = null) {
  complain(null);
  const fields = files.map((file) => field ?? fieldOf(file.name));
  // A photo with its log has its own camera and moment, and nothing belongs to the example.
  if (isExample || (fields.includes("photo") && fields.includes("gyro"))) fill({});
  isExample = false;
  try {
    for (const [i, file] of files.entries()) {
      busy(`Reading ${file.name}…`);
      const { path } = await ask(`upload?name=${encodeURIComponent(file.name)}`, file, "application/octet-stream");
      put(find(fields[i]), path);
    }
  } catch (error) {
    showChosen();
    complain(error);
    return;
  }
  const isVideo = files.some(({ name }) => /\.(mp4|mov|mkv|webm|avi|ts)$/i.test(name));
  await openIfComplete(isVideo ? " Of a video, only its gyro log is read here; rsdeblur video deblurs its frames." : "");
}

// The field that a file is for, by its name.
function fieldOf(name) {
  if (/\.(jpe?g|png|tiff?|webp|heic|heif|dng|npy)$/i.test(name)) return "photo";
  if (/\.(toml|ya?ml|json)$/i.test(name)) return "camera";
  return /frame|capture|metadata|stamps/i.test(name) ? "capture" : "gyro";
}

async function tryExample() {
  complain(null);
  busy("Simulating a shaken photo and its log. The first time, this compiles for up to a minute…");
  find("example").disabled = true;
  try {
    const answer = await ask("example", "{}");
    fill(answer.form);
    for (const name of ["photo", "gyro", "camera"]) put(find(name), answer.form[name]);
    isExample = true;
    await open();
  } catch (error) {
    complain(error);
  }
  find("example").disabled = false;
}

addEventListener("dragover", (event) => {
  event.preventDefault();
  document.body.classList.add("dropping");
});
addEventListener("dragleave", () => document.body.classList.remove("dropping"));
addEventListener("drop", (event) => {
  event.preventDefault();
  document.body.classList.remove("dropping");
  receive([...event.dataTransfer.files]);
});

// Result.

async function save() {
  find("saved").hidden = true;
  try {
    let saving = true;
    const done = ask("save", JSON.stringify(form())).finally(() => (saving = false));
    done.catch(() => {}); // reported below, after the answer to a question about the progress
    find("saving").hidden = false;
    while (saving) {
      const job = await ask("progress", "{}");
      find("saving-stage").textContent = job.stage;
      find("progress").value = job.fraction;
      await Promise.race([done, new Promise((next) => setTimeout(next, 200))]);
    }
    const facts = await done;
    complain(null);
    const verdict = facts.check ? `; check: ${facts.check.verdict}` : "";
    find("saved").textContent = `${facts.output}: written in ${facts.seconds.toFixed(1)} s${verdict}`;
    find("saved").hidden = false;
  } catch (error) {
    complain(error);
  }
  find("saving").hidden = true;
}

async function copy() {
  const line = find("line");
  try {
    await navigator.clipboard.writeText(line.value);
    find("copy").textContent = "Copied";
    setTimeout(() => (find("copy").textContent = "Copy command"), 2000);
  } catch {
    line.select(); // without permission, the user copies the selection
  }
}

async function start() {
  for (const name of SLIDERS) find(name).addEventListener("input", changedBySlider);
  for (const name of ["mode", "prior"]) find("controls").elements[name].addEventListener("change", () => solve(false));
  find("reset").addEventListener("click", () => {
    resetSliders();
    changedBySlider();
  });
  find("output").addEventListener("change", () => solve(true));
  find("open-form").addEventListener("submit", (event) => {
    event.preventDefault();
    open();
  });
  find("controls").addEventListener("submit", (event) => event.preventDefault());
  find("save").addEventListener("click", save);
  find("cancel").addEventListener("click", () => ask("cancel", "{}").catch(complain));
  find("copy").addEventListener("click", copy);
  find("choose").addEventListener("click", () => find("picker").click());
  find("example").addEventListener("click", tryExample);
  find("another").addEventListener("click", () => {
    fill({});
    for (const id of ["work", "found"]) find(id).hidden = true;
    find("start").hidden = false;
    find("title").textContent = "Deblur a photo";
    find("choose").focus();
  });
  for (const choice of document.querySelectorAll("input[type=file]")) {
    choice.addEventListener("change", () => receive([...choice.files], choice.dataset.for));
  }
  const { photos, form: given, camera } = await ask("start", "{}");
  find("photos").append(...photos.map((photo) => new Option("", photo)));
  fill({ photo: photos[0], ...given });
  if (camera) {
    find("last-camera").textContent = `Use the last camera file: ${lastPart(camera)}`;
    find("last-camera").hidden = false;
    find("last-camera").addEventListener("click", () => {
      find("camera").value = camera;
      openIfComplete();
    });
  }
  await openIfComplete();
}

start().catch(complain);
