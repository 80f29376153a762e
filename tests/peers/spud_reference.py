"""SPUD in double precision by scipy, the peer that crates/core/tests/suite/references.rs compares with.

Prints sampled values of phi for images that a formula defines:

    pip install numpy scipy
    python tests/peers/spud_reference.py > crates/core/tests/data/spud_golden.txt
"""

import numpy as np
from scipy.fft import dctn, idctn

# (height, width, channels, bits, threshold on, tau in units of the peak)
CASES = [
    (41, 67, 3, 8, "phi", 0.1),
    (41, 67, 3, 8, "rho", 0.1),
    (41, 67, 1, 6, "phi", 0.0),
    (1, 31, 1, 8, "phi", 0.1),
    (29, 1, 1, 8, "phi", 0.02),
    (64, 64, 1, 10, "phi", 0.1),
    (374, 1238, 1, 8, "phi", 0.1),
    (375, 1242, 1, 8, "phi", 0.0),
]
SAMPLES = 40


def scene(height, width, channels):
    """Slopes, a texture, and blocks whose edges break Itoh's condition; integers."""
    i, j, c = np.meshgrid(np.arange(height), np.arange(width), np.arange(channels), indexing="ij")
    triangle = lambda t, p: np.abs(t % (2 * p) - p)
    slopes = 2 * triangle(3 * i + j + 17 * c, 150) + 3 * triangle(2 * j + i + 40 * c, 97)
    return slopes + (7919 * i + 104729 * j + 1299709 * c) % 5 + 200 * ((i // 9 + j // 13) % 7 == 3)


def spud(y, peak, on, tau):
    """phi of one channel, before congruence."""
    centred = lambda d: np.mod(d + peak / 2, peak) - peak / 2
    gx, gy = centred(np.diff(y, axis=1)), centred(np.diff(y, axis=0))
    rho = np.zeros_like(y)
    rho[:, :-1] -= gx
    rho[:, 1:] += gx
    rho[:-1] -= gy
    rho[1:] += gy
    height, width = y.shape
    cosines = [np.cos(np.pi * np.arange(n) / n) for n in (height, width)]
    eigenvalues = 2 * (2 - cosines[0][:, None] - cosines[1][None])
    eigenvalues[0, 0] = 1
    spectrum = dctn(rho, norm="ortho")
    if on == "rho":
        spectrum = np.where(np.abs(spectrum) > tau * peak, spectrum, 0)
    spectrum = spectrum / eigenvalues
    if on == "phi":
        spectrum = np.where(np.abs(spectrum) > tau * peak, spectrum, 0)
    spectrum[0, 0] = 0
    return idctn(spectrum, norm="ortho")


for height, width, channels, bits, on, tau in CASES:
    print("case", height, width, channels, bits, on, tau)
    y = np.mod(scene(height, width, channels), 2**bits).astype(np.float64)
    phi = np.stack([spud(y[..., c], 2.0**bits, on, tau) for c in range(channels)], axis=-1)
    for n in range(SAMPLES):
        at = (n * n + 37 * n) % height, (7 * n * n + 101 * n) % width, n % channels
        print(*at, f"{phi[at]:.6f}")
