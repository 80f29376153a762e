"""Compares the methods of others with those of the suite: the tables of docs/research/peers.md.

    pip install "./python[examples]" && pip install -r python/examples/peers/requirements.txt
    python python/examples/field.py --out field                 # ten rendered frames
    python python/examples/field.py --out field SOURCE SOURCE   # frames of folders, a bag, or what else read_source takes
    python python/examples/field.py --stability                 # the scenes of the stability suite

Methods whose package is missing are named and left out. A run that is started again goes on where it was ended.
"""

import argparse
import importlib.util
import itertools
from pathlib import Path
from typing import Any

# First: it limits numpy to one thread.
from peers.adapters import ADAPTERS

import numpy as np

import modulo_camera as modulo

RENDERED = [f"scene://{name}?seed={seed}&frames=1" for name, seeds in
            (("day", (1, 2)), ("tunnel", (1, 2, 3)), ("glare", (1, 2, 3)), ("night", (1, 2))) for seed in seeds]  # fmt: skip


def middle(frame: modulo.Frame, number: int, source: str, height: int, width: int) -> modulo.Frame:
    """Returns the middle of a frame at its own resolution, with a name of its own."""
    rows, columns = frame.image.shape[:2]
    top, left = max(0, (rows - height) // 2), max(0, (columns - width) // 2)
    image: Any = np.ascontiguousarray(frame.image[top : top + height, left : left + width])
    return modulo.Frame(image, f"{Path(source).name} {number} {frame.name}", None, "", "none", None)


def settings_table(result: modulo.Benchmark, figure: str, digits: int, scale: float) -> str:
    """Returns a table in Markdown with a figure for each method and each combination of alpha and lens, and for each noise: means."""
    cells = result.cells
    columns: list[tuple[str, list[Any]]] = []
    for alpha, lens in dict.fromkeys((cell["alpha"], cell["psf_sigma"]) for cell in cells):
        columns.append((f"{alpha:g}, {lens:g} px", [cell for cell in cells if (cell["alpha"], cell["psf_sigma"]) == (alpha, lens)]))
    for noise in dict.fromkeys(cell["read_noise"] for cell in cells):
        columns.append((f"noise {noise:g}", [cell for cell in cells if cell["read_noise"] == noise]))
    lines = ["| alpha, lens | " + " | ".join(head for head, _ in columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for method in dict.fromkeys(cell["method"] for cell in cells):
        own = [[scale * cell[figure] for cell in column if cell["method"] == method and cell[figure] is not None] for _, column in columns]
        lines.append(f"| {method} | " + " | ".join(f"{np.mean(values):.{digits}f}" if values else "-" for values in own) + " |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sources", nargs="*", default=RENDERED, help="what read_source takes; without it, rendered scenes")
    parser.add_argument("--out", type=Path, default=Path("field"), help="the folder of the results and of the measured rows")
    parser.add_argument("--frames", type=int, default=4, help="the largest number of frames of each source")
    parser.add_argument("--size", type=int, nargs=2, default=(96, 192), metavar=("HEIGHT", "WIDTH"), help="the middle of a frame that is taken")
    parser.add_argument("--time-limit", type=float, default=100.0, help="the limit of a call in s")
    parser.add_argument("--stability", action="store_true", help="run the scenes of the stability suite instead of frames")
    options = parser.parse_args()
    # Not imported here: whirlwind starts threads when it is imported, for which a forked process would wait forever.
    methods = {name: adapter for name, (adapter, module) in ADAPTERS.items() if importlib.util.find_spec(module)}
    for name in ADAPTERS.keys() - methods.keys():
        print(f"{name} is left out: its module {ADAPTERS[name][1]} is missing (pip install -r python/examples/peers/requirements.txt)")
    if options.stability:
        for name, method in methods.items():
            print(f"{name}: {modulo.stability(method, time_limit_s=options.time_limit)}", flush=True)
        return
    frames = [
        middle(frame, number, source, *options.size)
        for source in options.sources
        for number, frame in enumerate(itertools.islice(modulo.read_source(source), options.frames))
    ]
    result = modulo.benchmark(methods, frames, out=options.out, repeats=1, time_limit_s=options.time_limit)
    print(result)
    for title, figure, digits, scale in (
        ("exact wrap counts, %", "exact_k", 1, 100.0),
        ("exact up to an offset for each channel, %", "up_to_offset", 1, 100.0),
        ("PSNR of the radiance, dB", "psnr_db", 1, 1.0),
    ):
        print(f"\n{title}\n\n{settings_table(result, figure, digits, scale)}")


if __name__ == "__main__":
    main()
