"""Images of one colour in each encoding that cameras have, with the colour that is to come of it."""

import numpy as np

HEIGHT, WIDTH = 16, 32
# Y, U and V of all pixels, and what BT.601 with the limited range makes of them.
LUMA, BLUE_CHROMA, RED_CHROMA = 120, 100, 160
RGB = [1.164 * (LUMA - 16) + 1.596 * (RED_CHROMA - 128),
       1.164 * (LUMA - 16) - 0.813 * (RED_CHROMA - 128) - 0.391 * (BLUE_CHROMA - 128),
       1.164 * (LUMA - 16) + 2.018 * (BLUE_CHROMA - 128)]
RED, GREEN, BLUE = (round(value) for value in RGB)
GREY = [GREEN] * 3
ALPHA = 77


def repeated(values, count):
    """The bytes `values` again and again, `count` bytes in all."""
    return bytes(values) * (count // len(values))


def encodings():
    """Encoding: bytes of a row of `step`, data, and the colour of each pixel."""
    pixels, u, v, y = HEIGHT * WIDTH, BLUE_CHROMA, RED_CHROMA, LUMA
    packed = {"uyvy": [u, y, v, y], "yuyv": [y, u, y, v]}
    packed |= {"yuv422": packed["uyvy"], "yuv422_yuy2": packed["yuyv"]}
    for name, values in packed.items():
        yield name, 2 * WIDTH, repeated(values, 2 * pixels), RGB
    for name, chroma, size in [("nv12", [u, v], pixels // 2), ("nv21", [v, u], pixels // 2), ("nv24", [u, v], 2 * pixels)]:
        yield name, WIDTH, repeated([y], pixels) + repeated(chroma, size), RGB
    for name, values in {"8UC4": [BLUE, GREEN, RED, ALPHA], "bgr16": [BLUE, GREEN, RED], "bgra16": [BLUE, GREEN, RED, ALPHA],
                         "rgba16": [RED, GREEN, BLUE, ALPHA], "16UC4": [BLUE, GREEN, RED, ALPHA], "mono16": [GREEN]}.items():
        samples = np.tile(np.array(values, "<u2" if "16" in name else "u1"), pixels)
        # As a fraction of 16 bits, each value is the same as of 8.
        data = (samples * 257 if "16" in name else samples).tobytes()
        yield name, len(data) // HEIGHT, data, GREY if name == "mono16" else RGB
