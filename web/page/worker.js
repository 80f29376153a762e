// Runs the core beside the page, which stays responsive. Each question of the page has one answer.
let core;
let picture;

const bytes = () => new Uint8Array(core.memory.buffer, core.address(), core.length()).slice();
const numbers = () => [...new Float64Array(bytes().buffer)];
const text = () => new TextDecoder().decode(bytes());

// The core returns 0 for an error, whose sentence is in its bytes.
function must(done) {
  if (!done) throw new Error(text());
  return done;
}

function put(file) {
  const address = core.reserve(file.byteLength);
  new Uint8Array(core.memory.buffer, address, file.byteLength).set(new Uint8Array(file));
}

// Takes a new picture, if there is one, and exposes the camera. The images have the forms for the screen, for the detector, which knows scenes
// only, and as codes.
function take({ file, picture: next, settings, streams, withCodes }) {
  if (file) {
    put(file);
    picture = { ...next, reduction: must(core.open()) };
  } else if (next) {
    core.render(next.scene);
    picture = next;
  }
  const { bits, alpha, sigma, noise, columns } = settings;
  must(core.expose(bits, alpha, sigma, noise, columns));
  const before = performance.now();
  must(core.recover());
  const ms = performance.now() - before;
  const written = (form) => [...Array(streams).keys()].map((stream) => must(core.image(stream, form)) && bytes());
  const images = [written(0), picture.reduction ? null : written(1), withCodes ? written(2) : null];
  core.numbers();
  const figures = numbers();
  core.method();
  return { ms, picture, settings, figures, images, method: text() };
}

function find({ pixels, height, width, ...asked }) {
  put(pixels);
  must(core.detect(height, width));
  return { numbers: numbers(), ...asked };
}

onmessage = async ({ data }) => {
  try {
    if (data.core) core = (await WebAssembly.instantiate(data.core)).exports;
    else postMessage(data.pixels ? find(data) : take(data));
  } catch (why) {
    const isFatal = !core || why instanceof WebAssembly.RuntimeError;
    postMessage({ isFatal, fault: isFatal ? `The program has failed (${why.message}). Please reload the page.` : why.message });
  }
};
