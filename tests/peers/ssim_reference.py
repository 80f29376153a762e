"""PSNR and SSIM by scikit-image, the peer that crates/core/tests/suite/references.rs compares with.

Prints one line for each pair of images that a formula defines:

    pip install numpy==2.4.6 scikit-image==0.26.0
    python tests/peers/ssim_reference.py > crates/core/tests/data/metric_golden.txt
"""

import numpy as np
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

# (height, width, channels, what the second image is)
CASES = [
    (11, 11, 1, "noise"),
    (11, 40, 3, "shift"),
    (37, 23, 3, "noise"),
    (37, 23, 1, "negative"),
    (64, 48, 3, "wrap"),
    (64, 48, 3, "flat"),
    (64, 48, 1, "shift"),
]


def image(height, width, channels):
    """Slopes, a texture and blocks; integers of 0 to 255."""
    i, j, c = np.meshgrid(np.arange(height), np.arange(width), np.arange(channels), indexing="ij")
    slope = 3 * i + 2 * j + 31 * c
    texture = (7919 * i + 104729 * j + 1299709 * c) % 23
    return np.minimum(slope + texture + 60 * ((i // 5 + j // 7) % 3 == 1), 255)


def partner(a, kind):
    height, width, channels = a.shape
    i, j, c = np.meshgrid(np.arange(height), np.arange(width), np.arange(channels), indexing="ij")
    return {
        "noise": np.clip(a + (31 * i + 17 * j + 7 * c) % 19 - 9, 0, 255),
        "shift": a[:, np.maximum(np.arange(width) - 1, 0)],
        "negative": 255 - a,
        "wrap": np.where((i // 16 + j // 16) % 2 == 1, a // 2, a),
        "flat": np.full_like(a, 128),
    }[kind]


for height, width, channels, kind in CASES:
    a = image(height, width, channels).astype(np.uint8)
    b = partner(image(height, width, channels), kind).astype(np.uint8)
    psnr = peak_signal_noise_ratio(a, b, data_range=255)
    ssim = structural_similarity(a, b, data_range=255, channel_axis=2, gaussian_weights=True, sigma=1.5,
                                 use_sample_covariance=False)
    print(height, width, channels, kind, f"{psnr:.9f} {ssim:.9f}")
