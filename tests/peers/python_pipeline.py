"""The time from a modulo image to its boxes in the suite and in the usual way in Python, on the same frames and engine.

    python3 -m venv venv && venv/bin/pip install numpy==2.4.6 scipy==1.17.1 scikit-image==0.26.0 \
        onnxruntime==1.31.1 opencv-python-headless==4.12.0.88
    venv/bin/python tests/peers/python_pipeline.py MODULO MODEL FRAMES [COUNT]

MODULO is a release build, MODEL a YOLOv10 in ONNX format, FRAMES a folder of images. In Python, a frame is the modulo
image in memory; SPUD by numpy and scipy and OpenCV's padding (or the padding without any unwrapping), PyPI's
onnxruntime with all cores, and the score threshold follow, frame after frame. The suite runs at RATE frames per second,
so that the simulation of the sensor, which is not counted, does not take a core from the network. All ways take turns,
twice, and the suite takes the ONNX Runtime library of the same wheel.
"""

import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import cv2
import numpy as np
import onnxruntime
from scipy.fft import dctn, idctn
from scipy.ndimage import correlate1d
from skimage.io import imread

ALPHA, BITS, SIGMA = 4.0, 8, 1.4
THRESHOLD = 0.25
EXTENSIONS = {".png", ".jpg", ".jpeg"}
TAU = 0.1
ROUNDS = 2
RATE = 10.0


def taps(sigma):
    """As crates/core/src/optics.rs."""
    radius = math.ceil(3 * sigma)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return weights / weights.sum()


def expose(path, alpha, bits, sigma):
    """floor(alpha 2^b blur(picture)), H x W x C; scipy's `mirror` is the camera's border."""
    picture = imread(path)
    picture = picture.reshape(*picture.shape[:2], -1)[..., :3]
    x = picture.astype(np.float32) / (256 if picture.dtype == np.uint8 else 65536)
    if sigma > 0:
        kernel = taps(sigma).astype(np.float32)
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


def padded(image):
    """The tensor of the network: padded to multiples of 32, in [0, 1]."""
    below, right = (-image.shape[0] % 32, -image.shape[1] % 32)
    image = cv2.copyMakeBorder(image, 0, below, 0, right, cv2.BORDER_CONSTANT, value=(114, 114, 114))
    return cv2.dnn.blobFromImage(image, scalefactor=1 / 255)


def recovered(spud, y):
    """SPUD's image on 8 bits: the nearest congruent image, from its smallest value on."""
    phi = np.moveaxis(spud(y, BITS), 0, -1)
    phi -= phi.min(axis=(0, 1))
    return cv2.convertScaleAbs(phi, alpha=255 / (ALPHA * 2**BITS))


def python_ms(session, frames, count, prepare):
    """The time of each frame."""
    name, times = session.get_inputs()[0].name, []
    prepare(frames[0])
    for number in range(count):
        start = time.perf_counter()
        rows = session.run(None, {name: padded(prepare(frames[number % len(frames)]))})[0][0]
        rows[rows[:, 4] >= THRESHOLD].tolist()
        times.append(1e3 * (time.perf_counter() - start))
    return times


def suite_ms(modulo, model, frames, count):
    """The median of each mode."""
    library = next((pathlib.Path(onnxruntime.__file__).parent / "capi").glob("libonnxruntime.so.*"))
    with tempfile.TemporaryDirectory() as out:
        subprocess.run(
            [modulo, "bench", "pipeline", "--frames", frames, "--model", model, "--engine", "ort", "--rate", str(RATE),
             "--alpha", str(ALPHA), "--psf-sigma", str(SIGMA), "--count", str(count), "--out", out],
            env=os.environ | {"ORT_DYLIB_PATH": str(library)}, check=True, stdout=subprocess.DEVNULL,
        )
        rows = json.loads((pathlib.Path(out) / "results.json").read_text())
    return {row["mode"]: row["p50_ms"] for row in rows}


def main():
    modulo, model, folder = sys.argv[1:4]
    count = int((sys.argv[4:] or ["100"])[0])
    paths = sorted(path for path in pathlib.Path(folder).rglob("*") if path.suffix in EXTENSIONS)
    if not paths:
        sys.exit(f"{folder}: there is no PNG or JPEG image in this folder")
    frames = [(expose(path, ALPHA, BITS, SIGMA) % 2**BITS).astype(np.uint8) for path in paths[:count]]
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    spud = NumpySpud(workers=os.cpu_count())
    ways = {
        "Python without unwrapping": lambda y: y,
        "Python with numpy SPUD": lambda y: recovered(spud, y),
    }
    medians = {}
    for _ in range(ROUNDS):
        for name, prepare in ways.items():
            medians.setdefault(name, []).extend(python_ms(session, frames, count // ROUNDS, prepare))
        for mode, median in suite_ms(modulo, model, folder, count).items():
            medians.setdefault(f"modulo, {mode}", []).append(median)
    print(f"{count} frames in {ROUNDS} turns, {os.cpu_count()} cores, ONNX Runtime {onnxruntime.__version__}")
    medians = {name: float(np.median(times)) for name, times in medians.items()}
    for name, ms in medians.items():
        ratios = " and ".join(f"{medians[way] / ms:.2f}x" for way in ways)
        print(f"{name:<26} {ms:6.1f} ms, {ratios} the frames per second of Python without and with SPUD")

main()
