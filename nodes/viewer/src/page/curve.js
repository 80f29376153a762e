// The display curve: how an image of radiance is shown to people. The files have sRGB's codes of radiance over their white, so that
// each curve is a table of 256 codes, which the browser applies as a filter of SVG.

import { byId, makeSvg } from "./dom.js";

// With the light L, which is the radiance in peaks of the sensor times 2^exposure, and w, the L of the image's white.
export const CURVES = {
  film: "film: bright parts roll off",
  clip: "gamma: clipped at white",
  detector: "linear: as the detector sees it",
};

const decodeSrgb = (code) => (code <= 0.04045 ? code / 12.92 : ((code + 0.055) / 1.055) ** 2.4);
const encodeSrgb = (light) => (light <= 0.0031308 ? 12.92 * light : 1.055 * light ** (1 / 2.4) - 0.055);

// Reinhard et al. (2002), eq. 4, with some contrast: the same as `DisplayCurve` of the suite at an exposure of 0.
function film(light, white) {
  return (white > 1 ? (light * (1 + light / white ** 2)) / (1 + light) : light) ** 1.8;
}

// The code in [0, 1] that shows a code of the file.
export function shownCode(code, peaks, { exposure, curve }) {
  const gain = 2 ** exposure;
  const light = gain * peaks * decodeSrgb(code);
  if (curve === "detector") return Math.min(1, gain * decodeSrgb(code));
  return encodeSrgb(Math.min(1, curve === "film" ? film(light, gain * peaks) : light));
}

const filters = new Map(); // name -> the table that it has

// The value of the CSS property `filter` for an image whose white is `peaks`; null: one that is no image of radiance.
export function filterOf(peaks, display) {
  if (peaks === null) return "none";
  const name = `curve-${`${peaks} ${display.exposure}`.replace(/[^0-9]/g, "_")}`;
  const table = Array.from({ length: 256 }, (_, code) => shownCode(code / 255, peaks, display).toFixed(4)).join(" ");
  if (filters.get(name) !== table) {
    filters.set(name, table);
    byId(name)?.remove();
    const channels = ["feFuncR", "feFuncG", "feFuncB"].map((tag) => makeSvg(tag, { type: "table", tableValues: table }));
    const transfer = makeSvg("feComponentTransfer", {}, ...channels);
    byId("filters").append(
      makeSvg("filter", { id: name, "color-interpolation-filters": "sRGB", x: 0, y: 0, width: 1, height: 1 }, transfer),
    );
  }
  return `url(#${name})`;
}

// The confidence image is 255 where a count is claimed to be right: its dark parts become a veil.
export function veilFilter() {
  if (!byId("veil")) {
    const matrix = "0 0 0 0 0.95  0 0 0 0 0.1  0 0 0 0 0.55  -0.55 0 0 0 0.55";
    byId("filters").append(
      makeSvg(
        "filter",
        { id: "veil", "color-interpolation-filters": "sRGB", x: 0, y: 0, width: 1, height: 1 },
        makeSvg("feColorMatrix", { values: matrix }),
      ),
    );
  }
  return "url(#veil)";
}
