"""Images of cameras with luma and chroma by OpenCV, the peer that msgs/tests/ros/yuv.rs compares with.

Prints one line for each image, encoding, height, width, step, data and RGB, the last two as hexadecimal digits:

    pip install numpy==2.4.6 opencv-python-headless==5.0.0.93
    python tests/peers/yuv_reference.py > msgs/tests/data/yuv_golden.txt
"""

import cv2
import numpy as np

HEIGHT, WIDTH = 6, 40
# Any values, with both ends of the range, beyond which the conversion must clamp.
random = np.random.default_rng(601)


def samples(*shape):
    any_value = random.integers(0, 256, shape)
    extreme = random.choice([0, 15, 16, 128, 235, 240, 255], shape)
    return np.where(random.random(shape) < 0.5, any_value, extreme).astype(np.uint8)


def line(encoding, planes, rgb, padding):
    """The planes with `padding` bytes of 0xa5 behind each row; a plane of two bytes a pixel has twice as many."""
    height, width, _ = rgb.shape
    row = planes[0].shape[1]
    padded = [np.pad(plane, ((0, 0), (0, padding * (plane.shape[1] // row))), constant_values=0xA5) for plane in planes]
    data = b"".join(plane.tobytes() for plane in padded)
    print(encoding, height, width, row + padding, data.hex(), rgb.tobytes().hex())


for padding in [0, 5]:
    for encoding, code in [("uyvy", cv2.COLOR_YUV2RGB_UYVY), ("yuyv", cv2.COLOR_YUV2RGB_YUYV)]:
        packed = samples(HEIGHT, WIDTH, 2)
        line(encoding, [packed.reshape(HEIGHT, -1)], cv2.cvtColor(packed, code), padding)
    for encoding, code in [("nv12", cv2.COLOR_YUV2RGB_NV12), ("nv21", cv2.COLOR_YUV2RGB_NV21)]:
        luma, chroma = samples(HEIGHT, WIDTH), samples(HEIGHT // 2, WIDTH)
        line(encoding, [luma, chroma], cv2.cvtColor(np.vstack([luma, chroma]), code), padding)
    # OpenCV cannot read nv24. With each of its pixels twice in both directions it is nv12.
    luma, chroma = samples(HEIGHT, WIDTH), samples(HEIGHT, 2 * WIDTH)
    doubled = np.vstack([luma.repeat(2, axis=0).repeat(2, axis=1), chroma])
    line("nv24", [luma, chroma], cv2.cvtColor(doubled, cv2.COLOR_YUV2RGB_NV12)[::2, ::2], padding)
