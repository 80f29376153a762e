// Where messages come from: the socket of the viewer, or the recording in this document.

import { byId } from "./dom.js";

const RETRY_MS = 2000;

// The JSON header and the files of a binary message.
function partsOf(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let offset = 4 + length;
  const files = header.images.map(({ bytes }) => {
    offset += bytes;
    return new Blob([new Uint8Array(buffer, offset - bytes, bytes)], { type: "image/jpeg" });
  });
  return [header, files];
}

export const recordingText = () => byId("recording")?.textContent ?? null;

// Calls `listen.event(event, at)` and `listen.images(header, files)` for each message of a recording.
export function playRecording(text, listen) {
  for (const [at, body] of JSON.parse(text)) {
    if (typeof body === "string") listen.images(...partsOf(Uint8Array.from(atob(body), (letter) => letter.charCodeAt(0)).buffer));
    else listen.event(body, at);
  }
}

// Why the viewer refuses a connection: a browser shows a script only the answer to another request.
async function refusal(address) {
  try {
    const answer = await fetch(address, { method: "POST" });
    return answer.headers.get("content-type")?.startsWith("text/plain") ? await answer.text() : "";
  } catch {
    return "";
  }
}

// Connects to the viewer, again and again. Returns the function that sends a request.
export function openSocket(listen) {
  const token = new URLSearchParams(location.search).get("token") ?? "";
  // Beside the page, which a reverse proxy may serve below a path.
  const address = new URL(`socket?token=${encodeURIComponent(token)}`, location.href);
  let socket = null;
  const connect = () => {
    socket = new WebSocket(address.href.replace(/^http/, "ws"));
    socket.binaryType = "arraybuffer";
    let opened = false;
    socket.onopen = () => {
      opened = true;
      listen.opened();
    };
    socket.onmessage = ({ data }) =>
      typeof data === "string" ? listen.event(JSON.parse(data), 0) : listen.images(...partsOf(data));
    socket.onclose = async () => {
      listen.closed(opened ? "" : await refusal(address));
      setTimeout(connect, RETRY_MS);
    };
  };
  connect();
  return (request) => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(request));
  };
}
