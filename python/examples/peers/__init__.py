"""Unwrapping by numpy, scipy and scikit-image: what a notebook without modulo would use. One thread each."""

import math
import os

# Before numpy is imported, which reads it once.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ[name] = "1"

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn, idctn
from skimage.restoration import unwrap_phase

Array = NDArray[Any]


def spud(codes: Array, bits: int, tau: float = 0.1) -> Array:
    """Returns phi (H x W x C, up to a constant) of SPUD: a Poisson equation of the wrapped differences, solved by cosine
    transforms in single precision, without the coefficients below `tau` peaks."""
    peak = np.float32(2**bits)
    planes = np.moveaxis(codes, -1, 0).astype(np.float32)
    along, across = (np.mod(np.diff(planes, axis=axis) + peak / 2, peak) - peak / 2 for axis in (2, 1))
    rho = np.zeros_like(planes)
    rho[:, :, :-1] -= along
    rho[:, :, 1:] += along
    rho[:, :-1] -= across
    rho[:, 1:] += across
    spectrum = dctn(rho, axes=(1, 2), norm="ortho", overwrite_x=True)
    rows, columns = (np.cos(np.pi * np.arange(side) / side, dtype=np.float32) for side in planes.shape[1:])
    eigenvalues = 2 * (2 - rows[:, None] - columns)
    eigenvalues[0, 0] = np.inf
    spectrum /= eigenvalues
    spectrum[np.abs(spectrum) <= tau * peak] = 0
    return np.moveaxis(idctn(spectrum, axes=(1, 2), norm="ortho", overwrite_x=True), 0, -1)


def unwrap_phases(codes: Array, bits: int) -> Array:
    """Returns phi (H x W x C, up to a multiple of the peak) of scikit-image's `unwrap_phase`, channel by channel."""
    scale = 2**bits / (2 * np.pi)
    phases = codes / np.float32(scale) - np.float32(np.pi)
    return np.stack([scale * unwrap_phase(phases[..., channel]) for channel in range(codes.shape[-1])], axis=-1)


def counts(phi: Array, codes: Array, bits: int, alpha: float, truth: Array) -> Array:
    """Returns the wrap counts of phi, in each channel with the constant that serves it best.

    Its fraction of a peak is that which leaves the residual smallest, its whole part comes from the true counts. `modulo` finds both
    by itself.
    """
    turns = (phi - codes) / 2.0**bits
    turns -= np.angle(np.mean(np.exp(2j * np.pi * turns), axis=(0, 1))) / (2 * np.pi)
    found = np.rint(turns).astype(np.int64)
    for channel in range(found.shape[-1]):
        shifts, votes = np.unique(truth[..., channel] - found[..., channel], return_counts=True)
        found[..., channel] += shifts[np.argmax(votes)]
    return found.clip(0, math.ceil(alpha) - 1)
