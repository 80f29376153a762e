"""The peers' side of `modulo bench unwrap`: numpy and scipy SPUD, scikit-image's unwrap_phase.

    python3 -m venv venv && venv/bin/pip install numpy==2.4.6 scipy==1.17.1 scikit-image==0.26.0
    modulo bench unwrap --frames FOLDER --out OUT
    venv/bin/python tests/peers/bench_unwrap.py FOLDER OUT/results.json --modulo PATH_OF_MODULO

Run it right after the command, on the same machine: it takes frames (8- and
16-bit PNG and JPEG), alphas and blur, bits and repeats from OUT/results.json
and OUT/meta.json, replaces its own rows in the list and draws the chart again.
One thread each. Nothing of modulo computes anything here.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"

import argparse
import json
import math
import pathlib
import subprocess
import sys
import time

import numpy as np
from scipy.fft import dctn, idctn
from scipy.ndimage import correlate1d
from skimage.io import imread
from skimage.restoration import unwrap_phase

EXTENSIONS = {".png", ".jpg", ".jpeg"}
TAU = 0.1


def taps(kernel, sigma):
    """As core/src/optics.rs."""
    if kernel == "paper7":
        return np.array([0.03125, 0.109375, 0.21875, 0.28125, 0.21875, 0.109375, 0.03125])
    radius = math.ceil(3 * sigma)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return weights / weights.sum()


def expose(path, alpha, bits, kernel, sigma):
    """floor(alpha 2^b blur(picture)), H x W x C; scipy's `mirror` is the camera's border."""
    picture = imread(path)
    picture = picture.reshape(*picture.shape[:2], -1)[..., :3]
    x = picture.astype(np.float32) / (256 if picture.dtype == np.uint8 else 65536)
    if sigma > 0:
        kernel = taps(kernel, sigma).astype(np.float32)
        x = correlate1d(correlate1d(x, kernel, axis=1, mode="mirror"), kernel, axis=0, mode="mirror")
    return np.floor(np.clip(alpha * 2**bits * x.astype(np.float64), 0, None)).astype(np.int32)


class NumpySpud:
    """One DCT pair over all channels at once, float32; eigenvalues are kept between frames."""

    name = "numpy_spud"

    def __init__(self, workers=1):
        self.inverse, self.workers = {}, workers

    def eigenvalues(self, height, width):
        if (height, width) not in self.inverse:
            rows, columns = (np.cos(np.pi * np.arange(n) / n) for n in (height, width))
            eigenvalues = 2 * (2 - rows[:, None] - columns[None])
            eigenvalues[0, 0] = np.inf
            self.inverse[height, width] = (1 / eigenvalues).astype(np.float32)[None]
        return self.inverse[height, width]

    def __call__(self, y, bits):
        """phi, C x H x W, of y, H x W x C, integers."""
        peak = 2**bits
        planes = np.ascontiguousarray(np.moveaxis(y, -1, 0))
        if bits == 8:
            gx, gy = (np.diff(planes, axis=axis).view(np.int8) for axis in (2, 1))
        else:
            planes = planes.astype(np.int32)
            gx, gy = ((np.diff(planes, axis=axis) + peak // 2) % peak - peak // 2 for axis in (2, 1))
        rho = np.zeros(planes.shape, np.float32)
        rho[:, :, :-1] -= gx
        rho[:, :, 1:] += gx
        rho[:, :-1] -= gy
        rho[:, 1:] += gy
        spectrum = dctn(rho, axes=(1, 2), norm="ortho", workers=self.workers, overwrite_x=True)
        spectrum *= self.eigenvalues(*planes.shape[1:])
        spectrum[np.abs(spectrum) <= TAU * peak] = 0
        return idctn(spectrum, axes=(1, 2), norm="ortho", workers=self.workers, overwrite_x=True)


class SkimageUnwrap:
    """Herraez et al. 2002, channel by channel."""

    name = "skimage_unwrap_phase"

    def __call__(self, y, bits):
        scale = 2**bits / (2 * np.pi)
        phase = y / np.float32(scale) - np.float32(np.pi)
        return np.stack([scale * unwrap_phase(phase[..., c]) for c in range(y.shape[-1])])


def wraps(phi, y, bits, alpha, truth):
    """k of each channel: the nearest congruent image, shifted as serves the peer best.

    phi is known up to a constant. Its fraction is that which leaves the
    residual of congruence smallest (the phase of its mean), its whole part
    comes from the truth. Neither is timed: what is timed is the peer's own
    call, so that both figures flatter the peer.
    """
    peak, most = 2**bits, math.ceil(alpha) - 1
    k = np.empty(y.shape, np.int64)
    for c, estimate in enumerate(phi):
        turns = (estimate - y[..., c].astype(np.float64)) / peak
        offset = np.angle(np.mean(np.exp(2j * np.pi * turns))) / (2 * np.pi)
        found = np.rint(turns - offset).astype(np.int64)
        shifts, counts = np.unique(truth[..., c] - found, return_counts=True)
        k[..., c] = np.clip(found + shifts[np.argmax(counts)], 0, most)
    return k


def shown(x, bits, alpha):
    return np.floor(x * (255 / (alpha * 2**bits)) + 0.5).clip(0, 255)


def measure(peer, frames, meta, alpha, sigma, repeats):
    bits, times, exact, squares, samples = meta["bits"], [], 0, 0.0, 0
    for path in frames:
        x = expose(path, alpha, bits, meta["psf"], sigma)
        y = (x % 2**bits).astype(np.uint8 if bits <= 8 else np.uint16)
        phi = peer(y, bits)
        for _ in range(repeats):
            start = time.perf_counter()
            peer(y, bits)
            times.append(1e3 * (time.perf_counter() - start))
        k = wraps(phi, y, bits, alpha, x // 2**bits)
        exact += int((k == x // 2**bits).sum())
        squares += float(((shown(y + k * 2**bits, bits, alpha) - shown(x, bits, alpha)) ** 2).sum())
        samples += x.size
    p5, p50, p95 = np.quantile(times, [0.05, 0.5, 0.95], method="inverted_cdf")
    psnr = 10 * math.log10(255**2 * samples / squares) if squares else None
    return {"method": peer.name, "alpha": alpha, "psf_sigma": sigma, "threads": 1, "ms_p50": p50, "ms_p5": p5,
            "ms_p95": p95, "exact_k": exact / samples, "psnr_db": psnr, "frames": len(frames), "samples": samples}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("results", type=pathlib.Path)
    parser.add_argument("--modulo", help="the command that draws the chart again")
    parser.add_argument("--repeats", type=int, help="as in meta.json when not given")
    options = parser.parse_args()
    rows = json.loads(options.results.read_text())
    meta = json.loads((options.results.parent / "meta.json").read_text())
    if meta["read_noise"]:
        sys.exit(f"read_noise is {meta['read_noise']}: the peers see no noise, only 0 is possible")
    frames = sorted(path for path in options.folder.iterdir() if path.suffix.lower() in EXTENSIONS)
    counts = {row["frames"] for row in rows}
    if counts != {len(frames)}:
        sys.exit(f"{len(frames)} frames in {options.folder}, {sorted(counts)} in {options.results}")
    peers = [NumpySpud(), SkimageUnwrap()]
    settings = sorted({(row["alpha"], row["psf_sigma"]) for row in rows})
    rows = [row for row in rows if row["method"] not in {peer.name for peer in peers}]
    for alpha, sigma in settings:
        for peer in peers:
            row = measure(peer, frames, meta, alpha, sigma, options.repeats or meta["repeats"])
            print(f"{peer.name} alpha {alpha}: {row['ms_p50']:.1f} ms, {100 * row['exact_k']:.3f} % exact")
            rows.append(row)
            options.results.write_text(json.dumps(rows, indent=2) + "\n")
    if options.modulo:
        subprocess.run([options.modulo, "bench", "chart", str(options.results.parent)], check=True)


if __name__ == "__main__":
    main()
