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

// Connects to the viewer, again and again. Returns the function that sends a request.
export function openSocket(listen) {
  const token = new URLSearchParams(location.search).get("token") ?? "";
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  let socket = null;
  const connect = () => {
    socket = new WebSocket(`${scheme}://${location.host}/socket?token=${encodeURIComponent(token)}`);
    socket.binaryType = "arraybuffer";
    let opened = false;
    socket.onopen = () => {
      opened = true;
      listen.opened();
    };
    socket.onmessage = ({ data }) =>
      typeof data === "string" ? listen.event(JSON.parse(data), 0) : listen.images(...partsOf(data));
    socket.onclose = () => {
      listen.closed(opened);
      setTimeout(connect, RETRY_MS);
    };
  };
  connect();
  return (request) => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(request));
  };
}
