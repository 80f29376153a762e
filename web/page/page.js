// Shows what the core in the workers makes of a picture, and sets its camera.
const byId = (id) => document.getElementById(id);
const content = (id) => byId(id).textContent;
// In the order of `Stream` of the core, and of `Class` of the scenes, with the colours that the suite gives them.
const STREAMS = ["Normal", "Modulo", "Recovered", "Ideal", "Wrap count k"];
const [RECOVERED, WRAP_COUNT] = [2, 4];
// The scene that is none of the presets.
const OWN = 4;
const CLASSES = [["car", "#ff9f1c"], ["van", "#4cb4ff"], ["truck", "#b07cff"], ["pedestrian", "#ff4d8d"], ["cyclist", "#00c896"]];
const SCENE = "seed=1&width=960&height=288&frames=1";
const SIDES = ["left", "right"];
const SETTINGS = ["alpha", "sigma", "noise", "bits"];
const LEAST_STOP = -8;
const BINS_OF_A_STOP = 2;
const BINS = 24;
// `boxes` are the last ones of each stream, each with the turn of the answer in whose image they were found.
const state = { name: "", answer: null, turn: 0, boxes: {}, readCodes: null };

// In the order of `Reason` of the core.
const REASONS = [
  () => "With an alpha of 1, no sample can wrap.",
  () => "The wrap counts do not contradict each other. The brightest parts show the absolute level: with one more wrap, they would leave the range of the camera.",
  () => "The wrap counts do not contradict each other. The shaded columns show the absolute level: they come out black.",
  () => "Neighbouring wrap counts agree, but nothing in the picture shows the absolute level: all counts may be too small by the same number. Shaded columns would show it.",
  ({ fit, settings }) => `Alpha ${settings.alpha} is too large for a lens blur of ${settings.sigma} px. Up to alpha ${fit}, nearly all wrap counts of real pictures are found behind such a lens.`,
  ({ jumps }) => `The wrap counts contradict each other: ${amount(1e6 * jumps)} of a million samples have a second difference above the modulus. A smaller alpha, a softer lens or less noise helps.`,
  () => "The wrap counts do not contradict each other, but an edge behind this lens may hide a wrong count without a trace. A softer lens or a smaller alpha helps.",
];
const LAST_TRUSTED = 2;

const amount = (value) => Number(value.toPrecision(2)).toLocaleString("en");
// A share in percent that is 100 only if it is all.
const percent = (share, digits) => {
  const most = 100 - 10 ** -digits;
  return share === 1 ? "100 %" : `${Math.min(100 * share, most).toFixed(digits)} %`;
};

function tell(text, isFault = false) {
  byId("status").textContent = text;
  byId("status").className = isFault ? "fault" : "";
}

const CODE = URL.createObjectURL(new Blob([content("worker")], { type: "text/javascript" }));

// Returns a function that asks a worker of its own. While it works, only the newest wish waits.
function asker(core, answered, asked = () => {}) {
  const worker = new Worker(CODE);
  let [isBusy, wanted] = [false, null];
  const ask = (wish) => {
    if (isBusy) {
      wanted = { ...wanted, ...wish };
      return;
    }
    [isBusy, wanted] = [true, null];
    asked();
    worker.postMessage(wish);
  };
  worker.onerror = cannotRun;
  worker.onmessage = ({ data }) => {
    isBusy = false;
    if (data.fault) tell(data.fault, true);
    else answered(data);
    if (!data.isFatal && wanted) ask(wanted);
  };
  worker.postMessage({ core });
  return ask;
}

const cannotRun = () => tell("This browser cannot run the program. Please use a browser of 2023 or later.", true);

const settings = () => ({
  ...Object.fromEntries(SETTINGS.map((id) => [id, Number(byId(id).value)])),
  columns: byId("columns").checked ? Number(byId("columns").value) : 0,
});

function expose(wish) {
  state.ask?.({ ...wish, settings: settings(), streams: STREAMS.length });
}

// Returns the codes of the modulo and of the recovered image, as `modulo simulate` writes them. For tests.
globalThis.readCodes = () => new Promise((done) => {
  state.readCodes = done;
  expose({ withCodes: true });
});

function show({ ms, picture: { name, scene, reduction }, settings, figures, images: [shown, read, codes], method }) {
  const [height, width, exact, reason, most, clipped, fit, jumps, ...rest] = figures;
  if (name !== state.name) {
    Object.assign(state, { name, boxes: {} });
    byId("scene").selectedIndex = scene ?? OWN;
  }
  state.turn += 1;
  state.answer = {
    images: shown.map((image) => onCanvas(new ImageData(new Uint8ClampedArray(image.buffer), width, height))),
    stops: rest.slice(0, BINS),
    objects: grouped(rest.slice(BINS), 5).map(([name, ...edges]) => ({ name, edges })),
    ...{ height, width, most, read },
  };
  const isTrusted = reason <= LAST_TRUSTED;
  const [verdict, why] = [document.createElement("b"), REASONS[reason]({ fit, jumps, settings })];
  verdict.textContent = isTrusted ? "Trusted: the method claims that all wrap counts are right." : "Not trusted.";
  byId("trust").replaceChildren(verdict, why);
  byId("badge").textContent = isTrusted ? "Recovered: trusted" : "Recovered: not trusted";
  byId("trust").className = byId("badge").className = isTrusted ? "good" : "";
  byId("truth").textContent = isTrusted ? "" : `The simulation knows that ${exact === 1 ? "all" : `only ${percent(exact, 3)} of the`} counts are right. The method cannot know: it sees the modulo image alone.`;
  byId("exact").textContent = percent(exact, 3);
  byId("most").textContent = `k = ${most}`;
  byId("time").textContent = `${ms.toFixed(1)} ms (${method})`;
  byId("clipped").textContent = `${percent(clipped, 1)} of the samples are at the modulus or above (0 stops), where a normal camera clips.`;
  byId("note").textContent = read ? "" : "Boxes are shown on the scenes only: the small detector of this page has learnt from rendered scenes, and does not know real pictures.";
  const reduced = reduction > 1 ? `, each of them the mean of ${reduction} × ${reduction} pixels of the file` : "";
  tell(`${name}, ${width} × ${height} pixels${reduced}.`);
  writeSettings();
  if (codes) state.readCodes([codes[1], codes[RECOVERED]]);
  byId("stage").style.aspectRatio = `${width} / ${height}`;
  draw();
}

const grouped = (numbers, size) => [...Array(numbers.length / size).keys()].map((index) => numbers.slice(index * size, (index + 1) * size));

function onCanvas(image) {
  const canvas = Object.assign(document.createElement("canvas"), { width: image.width, height: image.height });
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}

// Draws all, and has boxes found where those of the shown images are missing.
function draw() {
  if (!state.answer) return;
  drawHistogram();
  for (const side of SIDES) {
    drawSide(side);
    const [{ read, height, width }, stream, { turn }] = [state.answer, streamOf(side), state];
    if (!read || stream === WRAP_COUNT || state.boxes[stream]?.turn === turn) continue;
    state.askDetector[side]({ pixels: read[stream], height, width, stream, turn, name: state.name });
  }
}

// Takes the boxes that were found.
function mark({ numbers, stream, turn, name }) {
  if (name !== state.name) return;
  state.boxes[stream] = { turn, found: grouped(numbers, 6).map(([name, score, ...edges]) => ({ name, score, edges })) };
  SIDES.forEach(drawSide);
}

const streamOf = (side) => byId(side).selectedIndex;

// Returns a canvas that has a point for each one of the screen, empty.
function cleared(id) {
  const [canvas, scale] = [byId(id), globalThis.devicePixelRatio];
  const [width, height] = [canvas.clientWidth * scale, canvas.clientHeight * scale];
  Object.assign(canvas, { width, height });
  return { canvas, context: canvas.getContext("2d"), width, height, scale };
}

function drawSide(side) {
  const { canvas, context, width, height, scale } = cleared(`${side}-canvas`);
  const [{ images, objects, read, most }, stream] = [state.answer, streamOf(side)];
  context.drawImage(images[stream], 0, 0, width, height);
  const { found, turn } = state.boxes[stream] ?? {};
  const isNew = turn === state.turn;
  // The boxes of the last setting stay in sight, faintly, until those of this one are there.
  context.globalAlpha = isNew ? 1 : 0.35;
  context.scale(width / images[stream].width, height / images[stream].height);
  const point = (scale * images[stream].width) / width;
  for (const { name, edges: [left, top, right, bottom] } of (read && found) ?? []) {
    for (const [colour, line] of [["rgb(0 0 0 / 55%)", 3.5], [CLASSES[name][1], 2]]) {
      Object.assign(context, { strokeStyle: colour, lineWidth: line * point });
      context.strokeRect(left, top, right - left, bottom - top);
    }
  }
  const counted = isNew ? `${foundOf(objects, found)} of ${objects.length} objects found` : "looking for objects";
  byId(`${side}-found`).textContent = stream === WRAP_COUNT ? `0 is black, ${most} is white` : read ? counted : "";
  canvas.ariaLabel = `${STREAMS[stream]} image. ${content(`${side}-found`)}`;
}

// How many objects have a box of their own: of the same class, with an overlap of one half.
function foundOf(objects, boxes) {
  const free = new Set(boxes);
  const area = ([left, top, right, bottom]) => Math.max(0, right - left) * Math.max(0, bottom - top);
  const overlap = ({ edges: a }, { edges: b }) => {
    const both = area(a.map((edge, side) => (side < 2 ? Math.max(edge, b[side]) : Math.min(edge, b[side]))));
    return both / (area(a) + area(b) - both);
  };
  const isFound = (object) => {
    const [best] = [...free].filter(({ name }) => name === object.name).sort((a, b) => overlap(object, b) - overlap(object, a));
    return best && overlap(object, best) >= 0.5 && free.delete(best);
  };
  return objects.filter(isFound).length;
}

function drawHistogram() {
  const [{ stops }, colours] = [state.answer, getComputedStyle(document.documentElement)];
  const { canvas, context, width, height, scale } = cleared("histogram");
  // The first bin holds all that is darker: it must not flatten the others.
  const most = Math.max(...stops.slice(1), 0.02);
  stops.forEach((share, index) => {
    const top = Math.min(1, share / most) * (height - 4 * scale);
    context.fillStyle = colours.getPropertyValue(index / BINS_OF_A_STOP + LEAST_STOP >= 0 ? "--over" : "--accent");
    context.fillRect((index / stops.length) * width + scale, height - top, width / stops.length - 2 * scale, top);
  });
  context.strokeStyle = colours.getPropertyValue("--text");
  context.setLineDash([4 * scale, 3 * scale]);
  context.strokeRect((-LEAST_STOP * BINS_OF_A_STOP * width) / stops.length, -scale, 0, height + 2 * scale);
  canvas.ariaLabel = `Histogram of the light in stops. ${content("clipped")}`;
}

function writeSettings() {
  for (const id of SETTINGS) {
    const { value, dataset, parentElement } = byId(id);
    parentElement.querySelector("output").textContent = dataset.unit ? `${value} ${dataset.unit}` : value;
  }
  const { alpha, sigma, noise, bits, columns } = settings();
  const camera = Object.entries({ alpha, psf_sigma: sigma, read_noise: noise, bits, optical_black: columns });
  const { value: scene } = byId("scene");
  const parts = scene === "own"
    ? ["modulo simulate FILE --transfer srgb", ...camera.map(([name, value]) => `--${name.replace("_", "-")} ${value}`)]
    : ["modulo eval demo", `'source:=scene://${scene}?${SCENE}'`, ...camera.map(([name, value]) => `${name}:=${value}`)];
  byId("about-command").textContent = scene === "own"
    ? "The results are those of the command line, bit for bit, for pictures of at most one million pixels:"
    : "The boxes are those of the command line, with scores of at least 0.5:";
  // A line breaks between options only.
  byId("command").replaceChildren(...[...parts, "-o out"].map((textContent) => Object.assign(document.createElement("span"), { textContent: `${textContent} ` })));
}

// Shows a file, or the chosen scene.
async function open(file) {
  const bytes = await file?.arrayBuffer();
  if (bytes?.byteLength === 0) return tell(`${file.name} is empty.`, true);
  const { selectedOptions: [option], selectedIndex } = byId("scene");
  expose(file ? { file: bytes, picture: { name: file.name } } : { file: null, picture: { name: `The scene: ${option.text.toLowerCase()}`, scene: selectedIndex } });
}

function change() {
  writeSettings();
  expose({});
}

// The settings are in the address, which can be shared.
function readAddress() {
  const values = new URLSearchParams(location.hash.slice(1));
  for (const [name, value] of values) {
    const field = byId("settings").elements[name];
    if (field && name !== "columns") field.value = value;
  }
  if (values.size > 0) byId("columns").checked = values.has("columns");
  // A picture of one's own is not in the address.
  if (!byId("scene").value || byId("scene").value === "own") byId("scene").value = "glare";
  SIDES.filter((side) => !byId(side).value).forEach((side) => { byId(side).selectedIndex = 0; });
  writeSettings();
  moveLine();
  open();
}

function moveLine() {
  const { value } = byId("wipe");
  byId("line").style.left = `${value}%`;
  byId("right-canvas").style.clipPath = `inset(0 0 0 ${value}%)`;
}

function wipe({ clientX }) {
  const { left, width } = byId("stage").getBoundingClientRect();
  byId("wipe").value = Math.min(100, Math.max(0, (100 * (clientX - left)) / width));
  moveLine();
}

async function start() {
  const packed = await fetch(`data:application/gzip;base64,${content("core")}`);
  const stream = packed.body.pipeThrough(new DecompressionStream("gzip"));
  const core = await WebAssembly.compileStreaming(new Response(stream, { headers: { "Content-Type": "application/wasm" } }));
  state.ask = asker(core, show, () => tell("The program is working."));
  state.askDetector = Object.fromEntries(SIDES.map((side) => [side, asker(core, mark)]));
  readAddress();
}

for (const [side, stream] of [["left", 0], ["right", RECOVERED]]) {
  byId(side).append(...STREAMS.map((name, index) => new Option(name, name.split(" ")[0].toLowerCase(), index === stream, index === stream)));
  byId(side).onchange = draw;
}
byId("settings").oninput = change;
byId("reset").onclick = () => {
  for (const id of SETTINGS) byId(id).value = byId(id).defaultValue;
  byId("columns").checked = true;
  change();
};
byId("wipe").oninput = moveLine;
byId("scene").onchange = () => open();
document.onchange = () => history.replaceState(null, "", `#${new URLSearchParams(new FormData(byId("settings")))}`);
onhashchange = readAddress;
byId("stage").onpointerdown = (event) => {
  byId("stage").setPointerCapture(event.pointerId);
  wipe(event);
};
byId("stage").onpointermove = (event) => event.buttons && wipe(event);
byId("stage").onpointerup = document.onchange;
byId("file").onchange = ({ target }) => open(target.files[0]).then(() => { target.value = ""; });
document.ondragover = (event) => {
  event.preventDefault();
  document.body.classList.add("over");
};
document.ondragleave = () => document.body.classList.remove("over");
document.ondrop = (event) => {
  event.preventDefault();
  document.body.classList.remove("over");
  open(event.dataTransfer.files[0]);
};
addEventListener("resize", draw);
matchMedia("(prefers-color-scheme: dark)").onchange = draw;
start().catch(cannotRun);
