"""An own unwrapping method beside scikit-image and the methods of the suite: a table, and its results in a folder.

    pip install "./python[examples]"
    python python/examples/own_method.py
"""

from typing import Any

import numpy as np
from skimage.restoration import unwrap_phase

import modulo_camera as modulo


def rows(codes: Any, bits: int, alpha: float) -> Any:
    return np.unwrap(codes.astype(float), axis=1, period=2**bits)


def scikit_image(codes: Any, bits: int, alpha: float) -> Any:
    turn = 2**bits / (2 * np.pi)
    return np.stack([turn * (unwrap_phase(codes[..., c] / turn - np.pi) + np.pi) for c in range(codes.shape[-1])], axis=-1)


sensors = [modulo.Sensor(8, alpha, psf_sigma) for alpha in (2, 4) for psf_sigma in (0, 1)]
result = modulo.benchmark({"rows": rows, "scikit-image": scikit_image}, sensors=sensors, out="benchmark")
print(result)
