// Runs the core beside the page, which stays responsive. Each question of the page has one answer.
let core;
let reduction;

async function start(packed) {
  const bytes = Uint8Array.from(atob(packed), (character) => character.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const { instance } = await WebAssembly.instantiate(await new Response(stream).arrayBuffer());
  core = instance.exports;
}

const bytes = () => new Uint8Array(core.memory.buffer, core.address(), core.length()).slice();

// The core returns 0 for an error, whose sentence is in its bytes.
function must(done) {
  if (!done) throw new Error(new TextDecoder().decode(bytes()));
  return done;
}

function output(number) {
  must(core.output(number));
  return bytes();
}

// Opens a file; none is the sample.
function open(file) {
  const address = core.reserve(file.byteLength);
  new Uint8Array(core.memory.buffer, address, file.byteLength).set(new Uint8Array(file));
  reduction = must(core.open());
}

function take({ bits, alpha, sigma, noise, columns }) {
  must(core.expose(bits, alpha, sigma, noise, columns));
  const before = performance.now();
  must(core.recover());
  const ms = performance.now() - before;
  const figures = [...new Float64Array(output(0).buffer)];
  const images = [1, 2, 3].map((number) => output(number).buffer);
  return { ms, reduction, figures, images, method: new TextDecoder().decode(output(6)) };
}

onmessage = async ({ data }) => {
  try {
    if (data.core) await start(data.core);
    if (data.file) open(data.file);
    const answer = take(data.settings);
    if (data.codes) answer.codes = [output(4), output(5)];
    postMessage(answer, answer.images);
  } catch (why) {
    const isFatal = !core || why instanceof WebAssembly.RuntimeError;
    postMessage({ isFatal, fault: isFatal ? `The program has failed (${why.message}). Please reload the page.` : why.message });
  }
};
