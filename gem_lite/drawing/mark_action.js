// A person marks a pick and a place on the table seen from above. mark_action.py says what the traits mean.
// Angles are counter-clockwise seen from above; rows of the map grow with -y, columns with +x (gem_lite/se2.py).

const STYLE = `
.gem-mark { display: flex; flex-wrap: wrap; gap: 8px 20px; font: 14px/1.45 system-ui, sans-serif;
  color: var(--jp-ui-font-color0, inherit); }
.gem-mark canvas { display: block; max-width: 100%; touch-action: none; cursor: crosshair; }
.gem-mark :focus-visible { outline: 3px solid #56b4e9; outline-offset: 2px; }
.gem-mark .panel { flex: 1 1 15em; max-width: 26em; display: flex; flex-direction: column; gap: 12px; }
.gem-mark .hint { font-weight: 600; min-height: 2.9em; text-wrap: balance; }
.gem-mark .numbers { display: grid; grid-template-columns: repeat(5, max-content); gap: 2px 10px; align-items: center;
  margin-top: 8px; white-space: nowrap; font-variant-numeric: tabular-nums; }
.gem-mark .shape { width: 11px; height: 11px; box-sizing: border-box; border: 1px solid #000; outline: 1px solid #fff; }
.gem-mark .round { border-radius: 50%; }
.gem-mark label { display: flex; flex-direction: column; gap: 4px; }
.gem-mark textarea, .gem-mark button { font: inherit; color: inherit; background: transparent; padding: 4px 10px;
  border: 1px solid currentColor; border-radius: 4px; }
.gem-mark textarea { resize: vertical; box-sizing: border-box; width: 100%; }
.gem-mark button { cursor: pointer; min-width: 6em; margin-right: 8px; }
.gem-mark button:disabled { cursor: default; opacity: 0.5; }
.gem-mark button.keep:enabled { background: #0072b2; border-color: #0072b2; color: #fff; }
.gem-mark small { font-size: 12px; color: var(--jp-ui-font-color1, inherit); }
`;
const LEAST_DRAG = 6; // A shorter way of the pointer (pixels of the page) is a click.
const REACH = 14; // A press is on a mark if it is at most this far (pixels of the page) from it.
const LINE = 34; // The length of the line along the tool's x axis.
const TURN = Math.PI / 18; // One press of a key turns a mark by 10 degrees.
const NAMES = ["pick", "place"];

// Cells from the map's top left corner to metres in the table's frame, and back.
const toMetres = (table, right, down) => [table.x_min + right * table.cell, table.y_max - down * table.cell];
const toCells = (table, x, y) => [(x - table.x_min) / table.cell, (table.y_max - y) / table.cell];
const inside = (table, right, down) => right >= 0 && right < table.cols && down >= 0 && down < table.rows;
// The picture's "down" is -y. 0 - 0 is 0, but -0 would give -pi to the left.
const yawOf = (right, down) => Math.atan2(0 - down, right);
const wrap = (yaw) => Math.atan2(Math.sin(yaw), Math.cos(yaw));
const say = (value, digits) => {
  const text = Math.abs(value).toFixed(digits);
  return `${value < 0 && Number(text) !== 0 ? "−" : ""}${text}`;
};

function make(parent, tag, attributes = {}, text = "") {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.textContent = text;
  parent.append(element);
  return element;
}

// The table's colours, one pixel for each cell.
function pictureOf(table, rgb) {
  const picture = new OffscreenCanvas(table.cols, table.rows);
  const image = new ImageData(table.cols, table.rows);
  const bytes = new Uint8Array(rgb.buffer, rgb.byteOffset, rgb.byteLength);
  for (let cell = 0; cell < table.cols * table.rows; cell += 1) {
    image.data.set(bytes.subarray(3 * cell, 3 * cell + 3), 4 * cell);
    image.data[4 * cell + 3] = 255;
  }
  picture.getContext("2d").putImageData(image, 0, 0);
  return picture;
}

// Every line has a dark edge, so that it is seen on every table.
function stroke(context, color, path) {
  for (const [width, style] of [[6, "#000"], [3, color]]) {
    context.lineWidth = width;
    context.strokeStyle = style;
    context.stroke(path);
  }
}

// A circle (pick) or a square (place), a line along the tool's x axis, and the name beside it. (right, down): pixels.
function drawMark(context, name, color, right, down, yaw, taken) {
  const shape = new Path2D();
  if (name === "pick") shape.arc(0, 0, 9, 0, 2 * Math.PI);
  else shape.rect(-9, -9, 18, 18);
  const line = new Path2D();
  line.moveTo(9, 0);
  line.lineTo(LINE, 0);
  context.save();
  context.translate(right, down);
  context.rotate(-yaw); // a canvas turns clockwise
  stroke(context, color, line);
  stroke(context, color, shape);
  context.restore();
  drawName(context, name, right, down, yaw, taken);
}

// A name stands on the side without the line, or below, or above: where there is room and no other name.
function drawName(context, name, right, down, yaw, taken) {
  const { width, height } = context.canvas;
  const density = context.getTransform().a;
  const half = context.measureText(name).width / 2 + 2;
  const middle = Math.min(Math.max(right, half), width / density - half);
  const below = Math.sin(yaw) >= 0 ? 24 : -24;
  const beside = right - (Math.cos(yaw) >= 0 ? 1 : -1) * (half + 14);
  const places = [[beside, down], [middle, down + below], [middle, down - below]];
  const fits = ([x, y]) => x >= half && x <= width / density - half && y >= 10 && y <= height / density - 10;
  const apart = ([x, y], other) => Math.abs(x - other.x) > half + other.half || Math.abs(y - other.y) > 18;
  const free = (place) => taken.every((other) => apart(place, other));
  const [x, y] = places.find((place) => fits(place) && free(place)) ?? places[1];
  taken.push({ x, y, half });
  context.lineWidth = 4;
  context.strokeStyle = "#000";
  context.strokeText(name, x, y);
  context.fillStyle = "#fff";
  context.fillText(name, x, y);
}

function buildPage(el, colors) {
  make(el, "style", {}, STYLE);
  const root = make(el, "div", { class: "gem-mark" });
  const map = make(root, "div");
  const canvas = make(map, "canvas", {
    tabindex: "0", role: "application", "data-lm-suppress-shortcuts": "true",
    "aria-label": "The table from above. Click to mark the pick, then the place.",
  });
  const grid = make(map, "div", { class: "numbers" });
  const numbers = {};
  for (const name of NAMES) {
    const round = name === "pick" ? "round" : "";
    make(grid, "span", { class: `shape ${round}`, style: `background: ${colors[name]}` });
    make(grid, "span", {}, name);
    numbers[name] = ["x", "y", "yaw"].map((part) => make(grid, "span", { "data-number": `${name}-${part}` }));
  }
  const panel = make(root, "div", { class: "panel" });
  const hint = make(panel, "div", { class: "hint", "aria-live": "polite" });
  const label = make(panel, "label", {}, "sentence");
  const sentence = make(label, "textarea", { rows: "2", "data-lm-suppress-shortcuts": "true" });
  const buttons = make(panel, "div");
  const keep = make(buttons, "button", { type: "button", class: "keep" }, "keep");
  const undo = make(buttons, "button", { type: "button", class: "undo" }, "undo");
  undo.title = "take the last mark back";
  make(panel, "small", {},
    "Drag a mark again to turn it anew. Arrow keys move the mark by one cell, q and e turn it by 10 degrees. " +
    "Enter puts the next mark into the table's middle.");
  return { canvas, numbers, hint, sentence, keep, undo };
}

function hintFor(model, kept) {
  if (model.get("problem")) return `Not kept: ${model.get("problem")}`;
  if (!model.get("pick").length) return "Click where the tool shall pick; drag to turn it.";
  if (!model.get("place").length) return "Click where the tool shall place; drag to turn it.";
  if (!model.get("sentence").trim()) return "Write the sentence that a person would say.";
  return kept ? "Kept." : "Look at the marks and the sentence, then press keep.";
}

function render({ model, el }) {
  const table = model.get("table");
  const colors = model.get("colors");
  const picture = pictureOf(table, model.get("rgb"));
  const page = buildPage(el, colors);
  const { canvas } = page;
  const [width, height] = [table.cols * table.scale, table.rows * table.scale];
  const density = Math.max(1, window.devicePixelRatio);
  Object.assign(canvas, { width: width * density, height: height * density });
  canvas.style.width = `${width}px`;
  canvas.style.aspectRatio = `${width} / ${height}`;
  let active = null; // the mark that keys and drags change
  let press = null; // where the pointer went down, and the mark as it is meanwhile

  const snapshot = () => ({ pick: model.get("pick"), place: model.get("place"), sentence: model.get("sentence") });
  const isKept = () => {
    const [kept, now] = [model.get("kept"), snapshot()];
    return Object.keys(now).every((key) => JSON.stringify(kept[key]) === JSON.stringify(now[key]));
  };
  const last = () => (model.get("place").length ? "place" : model.get("pick").length ? "pick" : null);
  const change = (values) => {
    for (const [name, value] of Object.entries({ problem: "", ...values })) model.set(name, value);
  };

  function draw() {
    const context = canvas.getContext("2d");
    context.setTransform(density, 0, 0, density, 0, 0);
    context.imageSmoothingEnabled = false;
    context.drawImage(picture, 0, 0, width, height);
    Object.assign(context, { font: "600 14px system-ui, sans-serif", textAlign: "center", textBaseline: "middle" });
    Object.assign(context, { lineJoin: "round", lineCap: "round" });
    const taken = []; // where the names stand
    for (const name of NAMES) {
      const [x, y, yaw] = model.get(name);
      const marked = x !== undefined;
      if (marked) {
        const [right, down] = toCells(table, x, y).map((cells) => cells * table.scale);
        drawMark(context, name, colors[name], right, down, yaw, taken);
      }
      const degrees = (180 * yaw) / Math.PI;
      const texts = marked ? [`x ${say(x, 3)} m`, `y ${say(y, 3)} m`, `yaw ${say(degrees, 0)}°`] : ["–", "", ""];
      page.numbers[name].forEach((span, part) => (span.textContent = texts[part]));
    }
    const kept = isKept();
    page.hint.textContent = hintFor(model, kept);
    if (page.sentence.value !== model.get("sentence")) page.sentence.value = model.get("sentence");
    page.undo.disabled = last() === null;
    const complete = last() === "place" && model.get("pick").length > 0 && model.get("sentence").trim() !== "";
    page.keep.disabled = kept || !complete;
  }

  // The pointer in cells from the map's corner. The page may show the canvas smaller than it is.
  function cellsUnder(event) {
    const box = canvas.getBoundingClientRect();
    const [right, down] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    return [right * table.cols, down * table.rows];
  }

  // The mark under the pointer, once both marks are there: before that, each press makes a new mark.
  function markUnder(right, down) {
    if (!NAMES.every((name) => model.get(name).length)) return null;
    const reach = (REACH * table.cols) / canvas.getBoundingClientRect().width;
    const away = NAMES.map((name) => {
      const [x, y] = toCells(table, ...model.get(name));
      return Math.hypot(x - right, y - down);
    });
    const nearest = away[0] < away[1] ? 0 : 1;
    return away[nearest] <= reach ? NAMES[nearest] : null;
  }

  canvas.onpointerdown = (event) => {
    const [right, down] = cellsUnder(event);
    if (event.button !== 0 || press || !inside(table, right, down)) return;
    event.preventDefault();
    canvas.focus({ preventScroll: true });
    const missing = NAMES.find((name) => !model.get(name).length);
    const chosen = missing ?? markUnder(right, down);
    if (!chosen) return;
    active = chosen;
    // The kernel's answer to an earlier change may arrive during the press, so the mark is kept here until its end.
    const mark = missing ? [...toMetres(table, right, down), 0] : model.get(chosen);
    press = { id: event.pointerId, x: event.clientX, y: event.clientY, mark };
    change({ [active]: mark });
    canvas.setPointerCapture(event.pointerId);
  };
  canvas.onpointermove = (event) => {
    if (!press || event.pointerId !== press.id) return;
    const [right, down] = [event.clientX - press.x, event.clientY - press.y];
    if (Math.hypot(right, down) < LEAST_DRAG) return;
    press.mark = [press.mark[0], press.mark[1], yawOf(right, down)];
    change({ [active]: press.mark });
  };
  canvas.onpointerup = canvas.onpointercancel = (event) => {
    if (!press || event.pointerId !== press.id) return;
    change({ [active]: press.mark });
    press = null;
    model.save_changes();
  };
  canvas.onkeydown = (event) => {
    const missing = NAMES.find((name) => !model.get(name).length);
    if (event.key === "Enter" && missing && !event.shiftKey && !event.ctrlKey && !event.metaKey) {
      event.preventDefault();
      event.stopPropagation();
      active = missing;
      change({ [missing]: [...toMetres(table, table.cols / 2, table.rows / 2), 0] });
      model.save_changes();
      return;
    }
    const name = active && model.get(active).length ? active : last();
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const turns = { q: TURN, "[": TURN, e: -TURN, "]": -TURN };
    const known = event.key in moves || event.key in turns;
    if (!name || !known || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    let [x, y, yaw] = model.get(name);
    const [right, down] = toCells(table, x, y);
    const [byRight, byDown] = moves[event.key] ?? [0, 0];
    if (!inside(table, right + byRight, down + byDown)) return;
    if (event.key in moves) [x, y] = toMetres(table, right + byRight, down + byDown);
    change({ [name]: [x, y, wrap(yaw + (turns[event.key] ?? 0))] });
    model.save_changes();
  };
  page.undo.onclick = () => {
    change({ [last()]: [] });
    active = last();
    model.save_changes();
  };
  page.sentence.oninput = () => {
    change({ sentence: page.sentence.value.replaceAll("\n", " ") });
    model.save_changes();
  };
  page.sentence.onkeydown = (event) => event.stopPropagation();
  page.keep.onclick = () => {
    change({ kept: snapshot() });
    model.save_changes();
  };

  const watched = [...NAMES, "sentence", "kept", "problem"].map((name) => `change:${name}`);
  for (const name of watched) model.on(name, draw);
  draw();
  return () => watched.forEach((name) => model.off(name, draw));
}

export default { render };
