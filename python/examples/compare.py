"""Prints the time and the accuracy of `Sensor.unwrap` beside numpy, scipy and scikit-image as a table in Markdown.

    pip install "./python[examples]"
    python python/examples/compare.py                       # eight rendered frames of 1242 x 375
    python python/examples/compare.py FOLDER                # the images of a folder
    python python/examples/compare.py FOLDER --modulo target/release/modulo

The last form also measures what a call from Python costs beside a call from Rust, which `modulo simulate` times on the same frames.
"""

import argparse
import itertools
import json
import platform
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

# First: it limits numpy to one thread.
import peers

import numpy as np

import modulo_camera as modulo

Method = Callable[[peers.Array], peers.Array]

SCENES = [f"scene://{name}?seed={seed}&frames=1&width=1242&height=375"
          for name in ("day", "tunnel", "glare", "night") for seed in (1, 2)]  # fmt: skip


def milliseconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return 1e3 * (time.perf_counter() - start)


def own(method: str, alpha: float) -> Method:
    return lambda codes: modulo.Sensor(8, alpha).unwrap(codes, method).counts


def measure(name: str, method: Method, frames: list[modulo.Exposure], repeats: int, alpha: float) -> str:
    """Returns a row of the table. The first call of each frame is not timed."""
    times, exact = [], 0.0
    for frame in frames:
        found = method(frame.modulo)
        if not name.startswith("`Sensor"):
            found = peers.counts(found, frame.modulo, 8, alpha, frame.counts)
        exact += float(np.mean(found == frame.counts)) / len(frames)
        times += [milliseconds(lambda: method(frame.modulo)) for _ in range(repeats)]
    spread = statistics.quantiles(times, n=20)
    return f"| {name} | {statistics.median(times):.1f} | {spread[0]:.1f} to {spread[-1]:.1f} | {100 * exact:.3f} |"


def overhead(binary: Path, folder: Path, frames: list[modulo.Exposure], options: argparse.Namespace) -> str:
    """Returns the time of a call from Python beside that from Rust: medians over the same frames, measured by turns."""
    python, rust = [], []
    for _ in range(options.rounds):
        with tempfile.TemporaryDirectory() as out:
            command: list[str | Path] = [binary, "simulate", folder, "--out", out, "--method", "auto", "--optical-black", "0"]
            for name in ("alpha", "headroom", "psf_sigma", "repeats"):
                command += ["--" + name.replace("_", "-"), str(getattr(options, name))]
            subprocess.run(command, check=True, capture_output=True)
            rust.append(statistics.median(row["ms"] for row in json.loads((Path(out) / "results.json").read_text())))
        call = own("auto", options.alpha)
        times = [milliseconds(lambda: call(one.modulo)) for one in frames for _ in range(options.repeats + 1)]
        python.append(statistics.median(times))
    listed = [", ".join(f"{value:.2f}" for value in values) for values in (python, rust)]
    difference = statistics.median(python) - statistics.median(rust)
    return (
        f"A call of `auto`, median of each round: {listed[0]} ms from Python, {listed[1]} ms from Rust. "
        f"Difference of the medians: {difference:.2f} ms."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", help="images; without it, rendered scenes")
    parser.add_argument("--frames", type=int, default=20, help="the largest number of frames")
    parser.add_argument("--alpha", type=float, default=4.0)
    parser.add_argument("--headroom", type=float, default=0.97, help="full scale of the pictures over alpha * 2^8")
    parser.add_argument("--psf-sigma", type=float, default=1.4, help="the blur of the lens in px")
    parser.add_argument("--repeats", type=int, default=5, help="timed calls of each frame")
    parser.add_argument("--modulo", type=Path, help="the program, to measure the cost of a call from Python")
    parser.add_argument("--rounds", type=int, default=5, help="rounds of that measurement")
    options = parser.parse_args()
    sources = [str(options.folder)] if options.folder else SCENES
    radiance = itertools.chain.from_iterable(modulo.read_source(source) for source in sources)
    sensor = modulo.Sensor(8, options.alpha, options.psf_sigma, headroom=options.headroom)
    frames = [sensor.expose(frame.image) for frame in itertools.islice(radiance, options.frames)]
    methods: dict[str, Method] = {f"`Sensor.unwrap`, `{name}`": own(name, options.alpha) for name in modulo.METHODS}
    methods["SPUD in numpy and scipy"] = lambda codes: peers.spud(codes, 8)
    methods["scikit-image `unwrap_phase`"] = lambda codes: peers.unwrap_phases(codes, 8)
    print(f"{len(frames)} frames, {options.repeats} calls each, one thread, {platform.machine()}, "
          f"8 bits, alpha {options.alpha:g}, lens of {options.psf_sigma:g} px\n")  # fmt: skip
    print("| | median, ms | 5 % to 95 %, ms | exact k, % |\n|---|---|---|---|")
    for name, method in methods.items():
        print(measure(name, method, frames, options.repeats, options.alpha), flush=True)
    if options.modulo and options.folder:
        print("\n" + overhead(options.modulo, options.folder, frames, options))


if __name__ == "__main__":
    main()
