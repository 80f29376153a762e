// Shows what the core in the worker makes of a picture, and sets its camera.
const byId = (id) => document.getElementById(id);
const content = (id) => byId(id).textContent;
const STREAMS = ["Normal", "Modulo", "Recovered"];
const SETTINGS = ["alpha", "sigma", "noise", "bits"];
const LEAST_STOP = -8;
const BINS_OF_A_STOP = 2;
const state = { left: 0, right: 2, wipe: 50, answer: null, isBusy: true, wanted: null, name: "The sample: a rendered street", readCodes: null };

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

const worker = new Worker(URL.createObjectURL(new Blob([content("worker")], { type: "text/javascript" })));
worker.onerror = () => tell("This browser cannot run the program. Please use a browser of 2023 or later.", true);
worker.onmessage = ({ data }) => {
  state.isBusy = false;
  if (data.fault) tell(data.fault, true);
  else show(data);
  if (data.codes) state.readCodes(data.codes);
  if (!data.isFatal && state.wanted) ask(state.wanted);
};

const settings = () => ({
  ...Object.fromEntries(SETTINGS.map((id) => [id, Number(byId(id).value)])),
  columns: byId("columns").checked ? Number(byId("columns").value) : 0,
});

// Asks the worker; while it works, only the newest wish waits.
function ask(wish) {
  if (state.isBusy) {
    state.wanted = { ...state.wanted, ...wish };
    return;
  }
  [state.isBusy, state.wanted] = [true, null];
  tell("The program is working.");
  worker.postMessage({ ...wish, settings: settings() });
}

// Returns the codes of the modulo and of the recovered image, as `modulo simulate` writes them. For tests.
globalThis.readCodes = () => new Promise((done) => {
  state.readCodes = done;
  ask({ codes: true });
});

function show({ ms, reduction, figures, images, method }) {
  const [height, width, exact, reason, most, clipped, fit, jumps, ...stops] = figures;
  state.answer = { stops, images: images.map((image) => new ImageData(new Uint8ClampedArray(image), width, height)) };
  const isTrusted = reason <= LAST_TRUSTED;
  const [verdict, why] = [document.createElement("b"), REASONS[reason]({ fit, jumps, settings: settings() })];
  verdict.textContent = isTrusted ? "Trusted: the method claims that all wrap counts are right." : "Not trusted.";
  byId("trust").replaceChildren(verdict, why);
  byId("trust").className = isTrusted ? "good" : "";
  byId("exact").textContent = percent(exact, 3);
  byId("most").textContent = `k = ${most}`;
  byId("time").textContent = `${ms.toFixed(1)} ms (${method})`;
  byId("clipped").textContent = `${percent(clipped, 1)} of the samples are at the modulus or above (0 stops), where a normal camera clips.`;
  const reduced = reduction > 1 ? `, each of them the mean of ${reduction} × ${reduction} pixels of the file` : "";
  tell(`${state.name}, ${width} × ${height} pixels${reduced}.`);
  draw();
}

function draw() {
  byId("line").style.left = `${state.wipe}%`;
  byId("right-canvas").style.clipPath = `inset(0 0 0 ${state.wipe}%)`;
  for (const button of document.querySelectorAll("fieldset button")) {
    button.ariaPressed = String(state[button.dataset.side] === Number(button.dataset.stream));
  }
  if (!state.answer) return;
  for (const side of ["left", "right"]) {
    const [canvas, image] = [byId(`${side}-canvas`), state.answer.images[state[side]]];
    if (canvas.shown === image) continue;
    [canvas.width, canvas.height, canvas.shown] = [image.width, image.height, image];
    canvas.ariaLabel = `${STREAMS[state[side]]} image`;
    canvas.getContext("2d").putImageData(image, 0, 0);
    byId("stage").style.aspectRatio = `${image.width} / ${image.height}`;
  }
  drawHistogram();
}

function drawHistogram() {
  const [canvas, { stops }] = [byId("histogram"), state.answer];
  const [scale, colours] = [globalThis.devicePixelRatio, getComputedStyle(document.documentElement)];
  const [width, height] = [canvas.clientWidth * scale, canvas.clientHeight * scale];
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
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
  const command = `modulo simulate FILE --transfer srgb --alpha ${alpha} --psf-sigma ${sigma} --read-noise ${noise} --bits ${bits} --optical-black ${columns} -o out`;
  // A line breaks between options only.
  byId("command").replaceChildren(...command.split(/ (?=-)/).map((textContent) => Object.assign(document.createElement("span"), { textContent: `${textContent} ` })));
}

async function open(file) {
  if (!file) return;
  const bytes = await file.arrayBuffer();
  if (bytes.byteLength === 0) return tell(`${file.name} is empty.`, true);
  state.name = file.name;
  ask({ file: bytes });
}

function openSample() {
  state.name = "The sample: a rendered street";
  ask({ file: new ArrayBuffer(0) });
}

function change() {
  writeSettings();
  ask({});
}

function wipe({ clientX }) {
  const { left, width } = byId("stage").getBoundingClientRect();
  state.wipe = Math.min(100, Math.max(0, (100 * (clientX - left)) / width));
  byId("wipe").value = state.wipe;
  draw();
}

for (const side of ["left", "right"]) {
  byId(side).append(...STREAMS.map((textContent, stream) => {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent });
    Object.assign(button.dataset, { side, stream });
    button.onclick = () => draw(Object.assign(state, { [side]: stream }));
    return button;
  }));
}
byId("settings").oninput = change;
byId("settings").onreset = () => setTimeout(change);
byId("wipe").oninput = ({ target }) => draw(Object.assign(state, { wipe: Number(target.value) }));
byId("stage").onpointerdown = (event) => {
  byId("stage").setPointerCapture(event.pointerId);
  wipe(event);
};
byId("stage").onpointermove = (event) => event.buttons && wipe(event);
byId("sample").onclick = openSample;
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
writeSettings();
draw();
worker.postMessage({ core: content("core"), file: new ArrayBuffer(0), settings: settings() });
