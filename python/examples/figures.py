"""Draws two figures of a modulo camera: the four streams of one scene, and the accuracy of each method against its time.

    pip install "./python[examples]"
    python python/examples/figures.py --out figures

Both come from rendered scenes, so that no data are needed. A notebook may take the steps of `streams` and `frontier` as they are.
"""

import argparse
import statistics
import time
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from numpy.typing import NDArray

import modulo_camera as modulo

ALPHAS = (2.0, 3.0, 4.0)

# The height at which a method without a wrong count is drawn, %.
NO_ERROR = 3e-4

# Colours of Okabe and Ito, which readers with any colour vision tell apart, and a marker for each method.
COLOURS = ["#000000", "#D55E00", "#E69F00", "#999999", "#009E73", "#56B4E9", "#0072B2"]
MARKERS = "osD^vP*"

CLASSES = {"car": "#E69F00", "truck": "#B07AFF", "van": "#56B4E9", "pedestrian": "#FF4F81", "cyclist": "#00C08B"}

STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "savefig.dpi": 160,
}


def show(axes: Axes, image: NDArray[np.uint8], title: str, objects: list[modulo.GroundTruth]) -> None:
    """Draws an image and the boxes of its objects."""
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    axes.set_title(title)
    axes.axis("off")
    for one in objects:
        size, colour = (one.x2 - one.x1, one.y2 - one.y1), CLASSES[one.class_name]
        axes.add_patch(Rectangle((one.x1, one.y1), *size, fill=False, edgecolor=colour, linewidth=1.2))


def streams(file: Path) -> None:
    """The README's figure, with the labels: modulo and recovered above, saturated and ideal below."""
    scene = next(modulo.read_source("scene://glare?seed=4&frames=1"))
    sensor = modulo.Sensor(8, 4, psf_sigma=1)
    exposure = sensor.expose(scene.image)
    radiance, counts, (report,) = sensor.unwrap(exposure.modulo)
    exact = 100 * np.mean(counts == exposure.counts)
    panels: list[tuple[str, NDArray[np.uint8]]] = [
        ("modulo: wraps at the peak", exposure.modulo.astype(np.uint8)),
        (f"recovered by {report.method}: {exact:.4g} % of the wrap counts are exact", sensor.tone_map(radiance)),
        ("saturated: clipped at the peak", exposure.saturated.astype(np.uint8)),
        ("ideal: the whole range", exposure.ideal),
    ]
    height, width = scene.image.shape[:2]
    # Smaller boxes would hide their objects.
    objects = [one for one in scene.ground_truth or [] if one.y2 - one.y1 >= 12]
    figure, grid = plt.subplots(2, 2, figsize=(10, 10 * height / width + 0.9))
    figure.set_layout_engine("constrained", h_pad=0.06)
    for axes, (title, image) in zip(grid.flat, panels, strict=True):
        show(axes, image, title, objects)
    present = {one.class_name for one in objects}
    handles = [Patch(color=colour, label=name) for name, colour in CLASSES.items() if name in present]
    figure.legend(handles=handles, loc="outside lower left", ncols=len(handles), frameon=False, handlelength=1)
    figure.savefig(file)


def measured(method: str, exposures: list[modulo.Exposure], sensor: modulo.Sensor) -> tuple[float, float]:
    """The median time of a call in ms, and the share of wrong counts in percent."""
    times, wrong = [], []
    for exposure in exposures:
        for _ in range(3):
            start = time.perf_counter()
            counts = sensor.unwrap(exposure.modulo, method).counts
            times.append(1e3 * (time.perf_counter() - start))
        wrong.append(100 * float(np.mean(counts != exposure.counts)))
    return statistics.median(times), statistics.mean(wrong)


def frontier(file: Path) -> None:
    """Wrong counts against time behind a sharp lens, a line over alpha for each method."""
    addresses = [f"scene://{name}?seed={seed}" for name in ("tunnel", "glare", "night") for seed in (1, 2, 3)]
    scenes = [next(modulo.read_source(address)).image for address in addresses]
    figure, axes = plt.subplots(figsize=(8, 4.6), layout="constrained")
    for method, colour, marker in zip(modulo.METHODS, COLOURS, MARKERS, strict=True):
        points = []
        for alpha in ALPHAS:
            sensor = modulo.Sensor(8, alpha, psf_sigma=0.5, read_noise=1)
            time_ms, wrong = measured(method, [sensor.expose(scene) for scene in scenes], sensor)
            points.append((time_ms, max(wrong, NO_ERROR)))
        times, heights = zip(*points, strict=True)
        axes.plot(times, heights, color=colour, marker=marker, markersize=6, linewidth=1, label=method, clip_on=False)
        for alpha, point in zip(ALPHAS, points, strict=True):
            if point[1] > NO_ERROR:
                # Beside a neighbour at nearly the same place, the labels stand on the left.
                place = (-11, -3) if method in {"spud", "gradient_tree"} else (6, -3)
                axes.annotate(f"{alpha:g}", point, place, textcoords="offset points", color=colour, fontsize=8)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(100, NO_ERROR)
    axes.xaxis.set_major_locator(FixedLocator([0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200]))
    axes.yaxis.set_major_locator(FixedLocator([NO_ERROR, 0.001, 0.01, 0.1, 1, 10, 100]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: "0" if value <= NO_ERROR else f"{value:g}"))
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    height, width, channels = scenes[0].shape
    sensor_text = f"{len(scenes)} scenes of {width} x {height} x {channels}, lens of 0.5 px, read noise of 1 code"
    axes.set_xlabel(f"median time of a call on one thread, ms\n{sensor_text}")
    axes.set_ylabel("wrong wrap counts, %")
    axes.set_title("Accuracy and time of the methods at alpha 2, 3 and 4", pad=12)
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    figure.savefig(file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("figures"), help="the folder of the figures")
    folder: Path = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    plt.rcParams.update(STYLE)
    for draw in (streams, frontier):
        file = folder / f"{draw.__name__}.png"
        draw(file)
        print(file)


if __name__ == "__main__":
    main()
