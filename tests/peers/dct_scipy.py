"""Times scipy's cosine transforms beside ours, in one run.

    pip install numpy scipy
    python tests/peers/dct_scipy.py
"""

import subprocess

import time

import numpy as np
from scipy.fft import dctn, idctn

RUNS = 40


def least(work):
    work()
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def spud(y, tau):
    """Eq. 2 and 3 in float32; congruence with y, offset by the least k."""
    height, width, _ = y.shape
    y = y.astype(np.float32)
    centred = lambda d: np.mod(d + np.float32(128), np.float32(256)) - np.float32(128)
    gx, gy = centred(np.diff(y, axis=1)), centred(np.diff(y, axis=0))
    rho = np.zeros_like(y)
    rho[:, :-1] -= gx
    rho[:, 1:] += gx
    rho[:-1] -= gy
    rho[1:] += gy
    spectrum = dctn(rho, axes=(0, 1), norm="ortho", workers=1)
    cosine = lambda n: np.cos(np.pi * np.arange(n, dtype=np.float32) / n)
    divisor = 2 * (2 - cosine(height)[:, None] - cosine(width)[None])
    divisor[0, 0] = 1
    phi = spectrum / divisor[..., None]
    phi[np.abs(phi) <= tau * 256] = 0
    phi[0, 0] = 0
    phi = idctn(phi, axes=(0, 1), norm="ortho", workers=1)
    turns = np.mean(np.exp(2j * np.pi * (y - phi) / 256), axis=(0, 1))
    shift = (np.angle(turns) / (2 * np.pi)).astype(np.float32)
    k = np.floor((phi - y) / 256 + shift + 0.5).astype(np.int32)
    k -= k.min(axis=(0, 1))
    return y + 256 * k.astype(np.float32), k.astype(np.uint8)


def main():
    # The size of the frame of the bench.
    height, width = 375, 1242
    planes = np.random.default_rng(0).random((3, height, width), dtype=np.float32)
    pair = lambda: [idctn(dctn(p, norm="ortho", workers=1), norm="ortho", workers=1) for p in planes]
    print(f"scipy dct pair               least {least(pair):7.2f} ms")
    i, j = np.mgrid[:height, :width]
    y = np.stack([(3 * i + j + 17 * c) // 2 % 256 for c in range(3)], axis=2).astype(np.uint8)
    print(f"scipy spud                   least {least(lambda: spud(y, 0.1)):7.2f} ms")
    
    subprocess.run("cargo bench -p modulo-core --bench stages -- dct_pair least_squares spud".split(), check=True)


main()
