"""Methods of others as `modulo.benchmark` takes them: `f(codes, bits, alpha)` returns the radiance and the wrap counts.

Nothing of them is copied: each adapter imports its package, which the user installs (peers/requirements.txt has the versions of
docs/research/peers.md), and converts codes to what the package wants. All of them return phi up to a constant for each channel. `located` chooses the
constant as anybody could who does not know the true counts.
"""

import functools
import math
import os
from collections.abc import Callable
from typing import Any

import numpy as np

import peers
from peers import Array

Counted = tuple[Array, Array]

Adapter = Callable[[Array, int, float], Counted]


def located(phi: Array, codes: Array, bits: int, alpha: float) -> Counted:
    """Returns x and k of phi, which is known up to a constant for each channel.

    The fraction of the constant is that which leaves the residual smallest. Its whole part takes the most samples into the range 0 to
    ceil(alpha) - 1 of k, the smallest such part if there are several. x is phi with this constant.
    """
    turns = (phi - codes) / 2.0**bits
    fraction = np.angle(np.mean(np.exp(2j * np.pi * turns), axis=(0, 1))) / (2 * np.pi)
    counts = np.rint(turns - fraction).astype(np.int64)
    span = math.ceil(alpha)
    wholes = np.zeros(counts.shape[-1], np.int64)
    for channel in range(counts.shape[-1]):
        values, votes = np.unique(counts[..., channel], return_counts=True)
        # The range starts at one of the values, or the best one does not.
        inside = [votes[(values >= least) & (values < least + span)].sum() for least in values]
        highest = [votes[(values > most - span) & (values <= most)].sum() for most in values]
        starts = [*values, *(values - span + 1)]
        # The highest start is the lowest radiance.
        wholes[channel] = -max(zip([*inside, *highest], starts))[1]
    x = phi + 2.0**bits * (wholes - fraction)
    return x, (counts + wholes).clip(0, span - 1)


def congruent(phi: Array, codes: Array, bits: int, alpha: float) -> Counted:
    """Returns `located` with x = codes + k 2^bits."""
    k = located(phi, codes, bits, alpha)[1]
    return codes + 2.0**bits * k, k


def by_channel(unwrap: Callable[[Array], Array], codes: Array, bits: int) -> Array:
    """Returns phi of a function that unwraps phases in [-pi, pi), H x W, channel by channel."""
    scale = 2**bits / (2 * np.pi)
    # Half a code away from -pi: some packages take a phase of exactly 0 for a missing one.
    phases = ((codes + 0.5) / scale - np.pi).astype(np.float32)
    return np.stack([scale * np.asarray(unwrap(phases[..., c]), np.float64) for c in range(codes.shape[-1])], axis=-1)


def spud(codes: Array, bits: int, alpha: float) -> Counted:
    """SPUD in numpy and scipy (scipy.fft)."""
    return congruent(peers.spud(codes, bits), codes, bits, alpha)


def rows_then_columns(codes: Array, bits: int, alpha: float) -> Counted:
    """Itoh's method: `numpy.unwrap` down the first column, then along the rows."""
    lines = codes.astype(np.float64)
    phi = np.unwrap(lines, axis=1, period=2**bits)
    first = np.unwrap(lines[:, :1], axis=0, period=2**bits)
    return congruent(phi - phi[:, :1] + first, codes, bits, alpha)


def scikit_image(codes: Array, bits: int, alpha: float) -> Counted:
    """`skimage.restoration.unwrap_phase`: reliability sorting without a path (Herraez et al. 2002)."""
    return congruent(peers.unwrap_phases(codes, bits), codes, bits, alpha)


def opencv(codes: Array, bits: int, alpha: float) -> Counted:
    """`cv2.phase_unwrapping.HistogramPhaseUnwrapping` of OpenCV's contributed modules: reliability in histograms (Lei et al. 2015)."""
    import cv2

    cv2.setNumThreads(1)
    given = cv2.phase_unwrapping.HistogramPhaseUnwrapping.Params()
    given.height, given.width = codes.shape[:2]
    method = cv2.phase_unwrapping.HistogramPhaseUnwrapping.create(given)
    return congruent(by_channel(method.unwrapPhaseMap, codes, bits), codes, bits, alpha)


def snaphu(codes: Array, bits: int, alpha: float) -> Counted:
    """SNAPHU: network flow with statistical costs for radar images (Chen and Zebker 2001), at an even coherence of 0.95."""
    import snaphu as package

    def one(phases: Array) -> Array:
        coherence = np.full(phases.shape, 0.95, np.float32)
        unwrapped: Array = package.unwrap(np.exp(1j * phases).astype(np.complex64), coherence, nlooks=20.0)[0]
        return unwrapped

    # Its program prints each step.
    output = os.dup(1)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    try:
        return congruent(by_channel(one, codes, bits), codes, bits, alpha)
    finally:
        os.dup2(output, 1)
        os.close(output)


def whirlwind(codes: Array, bits: int, alpha: float) -> Counted:
    """whirlwind: network flow by minimum cost for radar images, at an even coherence of 0.95."""
    import whirlwind as package

    def one(phases: Array) -> Array:
        coherence = np.full(phases.shape, 0.95, np.float32)
        unwrapped: Array = package.unwrap(np.exp(1j * phases).astype(np.complex64), coherence, 20.0)[0]
        return unwrapped

    return congruent(by_channel(one, codes, bits), codes, bits, alpha)


def kamui_puma(codes: Array, bits: int, alpha: float) -> Counted:
    """kamui: PUMA, which minimizes an energy by graph cuts (Bioucas-Dias and Valadao 2007)."""
    import kamui

    return congruent(by_channel(lambda phases: kamui.unwrap_dimensional(phases, method="gc"), codes, bits), codes, bits, alpha)


def kamui_ilp(codes: Array, bits: int, alpha: float) -> Counted:
    """kamui: an integer linear program over the loops (Costantini 1998)."""
    import kamui

    return congruent(by_channel(lambda phases: kamui.unwrap_dimensional(phases), codes, bits), codes, bits, alpha)


def deepinverse_dct(codes: Array, bits: int, alpha: float) -> Counted:
    """DeepInverse: the closed form of its `ItohFidelity` for `SpatialUnwrapping`, by cosine transforms."""
    return located(_deepinverse(codes, bits, 0), codes, bits, alpha)


def deepinverse_admm_tv(codes: Array, bits: int, alpha: float) -> Counted:
    """DeepInverse: `ItohFidelity` with total variation, 10 iterations of ADMM."""
    return located(_deepinverse(codes, bits, 10), codes, bits, alpha)


def _deepinverse(codes: Array, bits: int, iterations: int) -> Array:
    import deepinv
    import torch

    torch.set_num_threads(1)
    image = torch.from_numpy(np.moveaxis(codes, -1, 0).astype(np.float32)[None] / 2**bits)
    physics: Any = deepinv.physics.SpatialUnwrapping(threshold=1.0, mode="floor")
    fidelity = deepinv.optim.ItohFidelity(threshold=1.0)
    with torch.no_grad():
        phi = fidelity.prox(None, image, physics)
        if iterations:
            prior = deepinv.optim.TVPrior(n_it_max=10)
            u, v = phi.clone(), torch.zeros_like(phi)
            for _ in range(iterations):
                # rho = 2 and a weight of 0.01 of the total variation, in units of the peak.
                phi = fidelity.prox(u - v, image, physics, gamma=2.0)
                u = prior.prox(phi + v, gamma=0.01)
                v = v + phi - u
            phi = u
    found: Array = np.moveaxis(phi[0].numpy().astype(np.float64), 0, -1) * 2**bits
    return found


def of_any_shape(adapter: Adapter) -> Adapter:
    """Returns an adapter that takes images H x W as well."""

    @functools.wraps(adapter)
    def wrapped(codes: Array, bits: int, alpha: float) -> Counted:
        x, k = adapter(np.atleast_3d(codes), bits, alpha)
        return x.reshape(codes.shape), k.reshape(codes.shape)

    return wrapped


_ADAPTERS: dict[str, tuple[Adapter, str]] = {
    "numpy unwrap": (rows_then_columns, "numpy"),
    "SPUD, scipy": (spud, "scipy"),
    "scikit-image": (scikit_image, "skimage"),
    "OpenCV histogram": (opencv, "cv2"),
    "whirlwind": (whirlwind, "whirlwind"),
    "SNAPHU": (snaphu, "snaphu"),
    "PUMA, kamui": (kamui_puma, "maxflow"),
    "ILP, kamui": (kamui_ilp, "kamui"),
    "DeepInverse DCT": (deepinverse_dct, "deepinv"),
    "DeepInverse ADMM-TV": (deepinverse_admm_tv, "deepinv"),
}

ADAPTERS = {name: (of_any_shape(adapter), module) for name, (adapter, module) in _ADAPTERS.items()}
"""Each adapter by its name, with the module that it needs."""
