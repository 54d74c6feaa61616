// A person marks points in a camera's picture. mark_pixels.py says what the traits mean.

const STYLE = `
.gem-pixels { display: flex; flex-wrap: wrap; align-items: flex-start; gap: 8px 20px; font: 14px/1.45 system-ui, sans-serif;
  color: var(--jp-ui-font-color0, inherit); }
.gem-pixels canvas { display: block; max-width: 100%; touch-action: none; cursor: crosshair; }
.gem-pixels :focus-visible { outline: 3px solid #56b4e9; outline-offset: 2px; }
.gem-pixels .panel { flex: 1 1 13em; max-width: 20em; display: flex; flex-direction: column; gap: 12px; }
.gem-pixels .hint { font-weight: 600; min-height: 2.9em; text-wrap: balance; }
.gem-pixels .numbers { font-variant-numeric: tabular-nums; }
.gem-pixels button { font: inherit; color: inherit; background: transparent; padding: 4px 10px; cursor: pointer;
  border: 1px solid currentColor; border-radius: 4px; align-self: flex-start; }
.gem-pixels button:disabled { cursor: default; opacity: 0.5; }
.gem-pixels small { font-size: 12px; color: var(--jp-ui-font-color1, inherit); }
`;
const LONGEST = 640; // The longest side of the drawn picture in pixels of the page.
const REACH = 14; // A press is on a point if it is at most this far (pixels of the page) from it.
const [LENS, ZOOM] = [135, 9]; // The lens's side in pixels of the page, and that of a picture's pixel in it.
const COLOR = "#e69f00";

function make(parent, tag, attributes = {}, text = "") {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.textContent = text;
  parent.append(element);
  return element;
}

// A cross with a dark edge, so that it is seen on every picture. Its middle stays free.
function drawCross(context, x, y, gap, length) {
  const cross = new Path2D();
  for (const [right, down] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    cross.moveTo(x + gap * right, y + gap * down);
    cross.lineTo(x + length * right, y + length * down);
  }
  for (const [width, style] of [[5, "#000"], [2.5, COLOR]]) {
    Object.assign(context, { lineWidth: width, strokeStyle: style, lineCap: "round" });
    context.stroke(cross);
  }
}

function drawNumber(context, text, x, y) {
  Object.assign(context, { font: "600 14px system-ui, sans-serif", lineWidth: 4, lineJoin: "round" });
  Object.assign(context, { strokeStyle: "#000", fillStyle: "#fff", textAlign: "center", textBaseline: "middle" });
  context.strokeText(text, x, y);
  context.fillText(text, x, y);
}

function buildPage(el) {
  make(el, "style", {}, STYLE);
  const root = make(el, "div", { class: "gem-pixels" });
  const canvas = make(root, "canvas", {
    class: "picture", tabindex: "0", role: "application", "data-lm-suppress-shortcuts": "true",
    "aria-label": "The camera's picture. Click to mark points.",
  });
  const panel = make(root, "div", { class: "panel" });
  const hint = make(panel, "div", { class: "hint", "aria-live": "polite" });
  const lens = make(panel, "canvas", { class: "lens", "aria-hidden": "true" });
  const numbers = make(panel, "div", { class: "numbers" });
  const undo = make(panel, "button", { type: "button", class: "undo" }, "undo");
  make(panel, "small", {},
    "Drag a point to move it. Arrow keys move the point under the magnifying glass by one pixel. Enter puts the next one into " +
    "the picture's middle.");
  return { canvas, hint, lens, numbers, undo };
}

async function render({ model, el }) {
  const [rows, cols] = model.get("size");
  const page = buildPage(el);
  const { canvas, lens } = page;
  const scale = Math.min(1, LONGEST / Math.max(rows, cols));
  const density = Math.max(1, window.devicePixelRatio);
  Object.assign(canvas, { width: Math.round(cols * scale * density), height: Math.round(rows * scale * density) });
  canvas.style.width = `${cols * scale}px`;
  canvas.style.aspectRatio = `${cols} / ${rows}`;
  Object.assign(lens, { width: LENS * density, height: LENS * density });
  lens.style.width = `${LENS}px`;
  const picture = await createImageBitmap(new Blob([model.get("picture")], { type: "image/png" }));
  const small = new OffscreenCanvas(canvas.width, canvas.height); // drawn once: the picture may be large
  const smaller = small.getContext("2d");
  smaller.imageSmoothingQuality = "high";
  smaller.drawImage(picture, 0, 0, small.width, small.height);
  let active = null; // the number of the point that the lens shows and keys move
  let press = null; // the pointer that is down, and the points before it

  const inside = ([x, y]) => x >= 0 && x < cols && y >= 0 && y < rows;
  const points = () => model.get("pixels");
  const chosen = () => Math.min(active ?? Infinity, points().length - 1);

  function drawLens(pixel) {
    const context = lens.getContext("2d");
    context.setTransform(density, 0, 0, density, 0, 0);
    context.fillStyle = "#888";
    context.fillRect(0, 0, LENS, LENS);
    if (!pixel) return;
    context.imageSmoothingEnabled = false;
    // The marked pixel stands in the lens's middle.
    const left = LENS / 2 - (pixel[0] + 0.5) * ZOOM;
    const top = LENS / 2 - (pixel[1] + 0.5) * ZOOM;
    context.drawImage(picture, left, top, cols * ZOOM, rows * ZOOM);
    drawCross(context, LENS / 2, LENS / 2, 0.8 * ZOOM, 3 * ZOOM);
  }

  function draw() {
    const context = canvas.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(small, 0, 0);
    context.setTransform(density, 0, 0, density, 0, 0);
    points().forEach(([x, y], number) => {
      const [right, down] = [(x + 0.5) * scale, (y + 0.5) * scale];
      drawCross(context, right, down, 4, 12);
      const [toRight, toDown] = [right < 30 ? 14 : -14, down < 30 ? 14 : -14];
      drawNumber(context, String(number + 1), right + toRight, down + toDown);
    });
    drawLens(points()[chosen()]);
    const [marked, count] = [points().length, model.get("count")];
    page.hint.textContent = marked < count ? `Click point ${marked + 1} of ${count}.` : "All points are marked.";
    page.numbers.textContent = points().flat().join(" ");
    page.undo.disabled = marked === 0;
  }

  // The pixel under the pointer. The page may show the canvas smaller than it is.
  function pixelUnder(event) {
    const box = canvas.getBoundingClientRect();
    const [right, down] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    return [Math.floor(right * cols), Math.floor(down * rows)];
  }

  // The number of the point that a press moves: one under the pointer, a new one, or null if there is none.
  function pressed([x, y]) {
    const reach = (REACH * cols) / canvas.getBoundingClientRect().width;
    const away = points().map((point) => Math.hypot(point[0] - x, point[1] - y));
    const nearest = away.indexOf(Math.min(...away));
    if (away[nearest] <= reach) return nearest;
    return points().length < model.get("count") ? points().length : null;
  }

  // Move a point, or add the next one.
  function put(number, pixel) {
    const pixels = [...points()];
    pixels[number] = pixel;
    active = number;
    model.set("pixels", pixels);
    draw(); // the lens moves, even if the point does not
  }

  canvas.onpointerdown = (event) => {
    const pixel = pixelUnder(event);
    if (event.button !== 0 || press || !inside(pixel)) return;
    event.preventDefault();
    canvas.focus({ preventScroll: true });
    const number = pressed(pixel);
    if (number === null) return;
    canvas.setPointerCapture(event.pointerId);
    press = { id: event.pointerId, before: points() };
    put(number, pixel);
  };
  canvas.onpointermove = (event) => {
    const pixel = pixelUnder(event);
    if (press && event.pointerId === press.id && inside(pixel)) put(active, pixel);
  };
  canvas.onpointerup = (event) => {
    if (!press || event.pointerId !== press.id) return;
    press = null;
    model.save_changes();
  };
  canvas.onpointercancel = (event) => {
    if (!press || event.pointerId !== press.id) return;
    model.set("pixels", press.before);
    press = null;
  };
  canvas.onkeydown = (event) => {
    if (press || event.ctrlKey || event.metaKey || event.altKey || event.shiftKey) return;
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const isNew = event.key === "Enter" && points().length < model.get("count");
    if (!isNew && !(event.key in moves && points().length)) return;
    event.preventDefault();
    event.stopPropagation();
    const [right, down] = moves[event.key] ?? [0, 0];
    const [x, y] = points()[chosen()] ?? [0, 0];
    const pixel = isNew ? [Math.floor(cols / 2), Math.floor(rows / 2)] : [x + right, y + down];
    if (!inside(pixel)) return;
    put(isNew ? points().length : chosen(), pixel);
    model.save_changes();
  };
  page.undo.onclick = () => {
    if (press) return;
    active = null;
    model.set("pixels", points().slice(0, -1));
    model.save_changes();
  };

  model.on("change:pixels", draw);
  draw();
  return () => model.off("change:pixels", draw);
}

export default { render };
