"""Draws the charts of the research record from its tables: `python docs/research/charts.py`. Needs matplotlib."""

import csv
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

HERE = Path(__file__).parent
mpl.use("Agg")
mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "modulo", "font.family": "DejaVu Sans, sans-serif", "font.size": 9})
Rows = list[dict[str, str]]
GAINS = {"none": "one gain", "checkerboard": "two gains"}
CHIPS = {"none": "three chips", "rggb": "mosaic rggb"}


def table(name: str) -> Rows:
    with (HERE / name).open(newline="") as file:
        return list(csv.DictReader(file))


def where(rows: Rows, **values: str) -> Rows:
    return [row for row in rows if all(row[key] == value for key, value in values.items())]


def grid(rows: Rows, down: str, across: str, value: str) -> tuple[Any, list[str], list[str]]:
    """The values as an array, and the names of its rows and columns in the order in which they stand in the table."""
    names = [list(dict.fromkeys(row[key] for row in rows)) for key in (down, across)]
    found = np.full([len(name) for name in names], np.nan)
    for row in rows:
        found[names[0].index(row[down]), names[1].index(row[across])] = float(row[value])
    return found, *names


def heat(ax: Any, values: Any, down: list[str], across: list[str], title: str, low: float, high: float = 100.0) -> None:
    ax.imshow(values, cmap="viridis", vmin=low, vmax=high, aspect="auto")
    ax.set(title=title, xticks=range(len(across)), xticklabels=across, yticks=range(len(down)), yticklabels=down)
    for (i, j), value in np.ndenumerate(values):
        dark = value < low + 0.6 * (high - low)
        ax.text(j, i, f"{value:.1f}", ha="center", va="center", size=8, color="white" if dark else "black")


def lines(ax: Any, rows: Rows, x: str, y: str, by: str, title: str) -> None:
    for number, name in enumerate(dict.fromkeys(row[by] for row in rows)):
        points = [(float(row[x]), float(row[y])) for row in rows if row[by] == name]
        ax.plot(*zip(*points, strict=True), marker="osD^vP"[number % 6], label=name)
    ax.set(title=title, xlabel="alpha" if x == "alpha" else x)
    ax.grid(alpha=0.3)


def save(figure: Any, name: str) -> None:
    (HERE / "charts").mkdir(exist_ok=True)
    figure.savefig(HERE / "charts" / f"{name}.svg", metadata={"Date": None}, bbox_inches="tight")
    plt.close(figure)


def one_gain() -> None:
    figure, axes = plt.subplots(1, 3, figsize=(10, 2.4), layout="constrained")
    for ax, noise in zip(axes, ("0", "10", "30"), strict=True):
        values, down, across = grid(where(table("data/one_gain_noise.csv"), read_noise=noise), "alpha", "psf_sigma", "exact_percent")
        heat(ax, values, down, across, f"noise of {noise} codes", 20)
        ax.set(xlabel="lens blur, px", ylabel="alpha")
    save(figure, "one_gain")


def sensors() -> None:
    figure, axes = plt.subplots(2, 4, figsize=(13, 4.6), layout="constrained")
    rows = table("data/sensors.csv")
    for row, (pixels, column) in zip(axes, (("modulo", "ap50_recovered"), ("saturating", "ap50_saturated")), strict=True):
        kinds = [(mosaic, gains) for mosaic in CHIPS for gains in GAINS]
        for ax, (mosaic, gains) in zip(row, kinds, strict=True):
            values, down, across = grid(where(rows, mosaic=mosaic, gains=gains), "alpha", "psf_sigma", column)
            heat(ax, values, down, across, f"{pixels}, {CHIPS[mosaic]}, {GAINS[gains]}", 20)
            ax.set(xlabel="lens blur, px", ylabel="alpha")
    save(figure, "sensors")


def radiance() -> None:
    figure, axes = plt.subplots(1, 4, figsize=(12, 2.6), sharey=True, layout="constrained")
    kinds = [(pictures, gains) for pictures in ("rendered", "hdr") for gains in GAINS]
    for ax, (pictures, gains) in zip(axes, kinds, strict=True):
        rows = where(table("data/radiance.csv"), pictures=pictures, gains=gains)
        lines(ax, rows, "alpha", "error_stops_all", "pixels", f"{pictures}, {GAINS[gains]}")
        ax.set_xscale("log", base=2)
    axes[0].set_ylabel("error of all samples, stops")
    axes[0].legend()
    save(figure, "radiance")


def peers() -> None:
    figure, axes = plt.subplots(1, 2, figsize=(13, 4.4), layout="constrained")
    rows = [row for row in table("data/peers_sensors.csv") if row["alpha"]]
    mean = {row["method"]: float(row["exact_percent"]) for row in where(table("data/peers.csv"), frames="real")}
    rows = [{**row, "sensor": f"{row['alpha']}, {row['psf_sigma']} px"} for row in sorted(rows, key=lambda row: -mean[row["method"]])]
    for ax, frames in zip(axes, ("rendered", "real"), strict=True):
        values, down, across = grid(where(rows, frames=frames), "method", "sensor", "exact_percent")
        heat(ax, values, down, across, f"{frames} frames", 0)
        ax.tick_params("x", rotation=30)
    save(figure, "peers")


def paper() -> None:
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.2), sharey=True, layout="constrained")
    lines(axes[0], table("data/paper_protocol.csv"), "alpha", "ap50_vehicles", "input", "protocol of the paper")
    lines(axes[1], table("data/paper_spud.csv"), "alpha", "ap50_vehicles", "input", "sensor of the suite, lens of 1.4 px")
    axes[0].set_ylabel("AP50 of vehicles, %")
    for ax in axes:
        ax.legend(fontsize=7)
    save(figure, "paper")


def night() -> None:
    figure, axes = plt.subplots(2, 2, figsize=(9, 4.6), sharex=True, sharey=True, layout="constrained")
    for row, well in zip(axes, ("1000", "10000"), strict=True):
        for ax, group in zip(row, ("vehicles", "persons"), strict=True):
            rows = where(table("data/night.csv"), full_well_electrons=well)
            lines(ax, rows, "alpha", f"ap50_{group}", "images", f"{group}, {well} electrons")
    axes[0][0].set_ylabel("AP50, %")
    axes[0][1].legend(fontsize=7)
    save(figure, "night")


def input_size() -> None:
    figure, ax = plt.subplots(figsize=(6, 3.2), layout="constrained")
    rows = table("data/input_size.csv")
    for column in list(rows[0])[2:]:
        ax.plot([float(row["ms"]) for row in rows], [float(row[column]) for row in rows], "o-", label=column.replace("_", ", "))
    ax.set(xlabel="time of the network, ms", ylabel="AP50, %")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=7)
    save(figure, "input_size")


def trained_on_wraps() -> None:
    figure, axes = plt.subplots(1, 3, figsize=(12, 2.8), sharey=True, layout="constrained")
    rows = where(table("trained_on_wraps.csv"), psf_sigma="1.0", optical_black="0")
    for ax, stream in zip(axes, ("modulo", "recovered", "saturated"), strict=True):
        means: dict[tuple[str, str], list[float]] = {}
        for row in where(rows, stream=stream):
            means.setdefault((row["trained_on"], row["alpha"]), []).append(100 * float(row["ap50"]))
        found = [{"trained on": on, "alpha": alpha, "ap50": str(np.mean(all_))} for (on, alpha), all_ in means.items()]
        lines(ax, found, "alpha", "ap50", "trained on", f"{stream} images")
    axes[0].set_ylabel("AP50, %")
    axes[0].legend(fontsize=7, title="trained on")
    save(figure, "trained_on_wraps")


def growth() -> None:
    figure, axes = plt.subplots(1, 4, figsize=(13, 2.8), layout="constrained")
    for ax, axis in zip(axes, ("megapixels", "threads", "alpha", "cameras"), strict=True):
        lines(ax, where(table("data/growth.csv"), axis=axis), "value", "ms", "method", axis)
        ax.set(xlabel="", xscale="log", yscale="log" if axis in ("megapixels", "alpha") else "linear")
        ticks = [1, 2, 4, 8] if axis == "cameras" else [1, 2] if axis == "threads" else [0.1, 1, 10] if axis == "megapixels" else [1, 4, 16, 80]
        ax.set_xticks(ticks, [str(tick) for tick in ticks])
        ax.minorticks_off()
    axes[0].set_ylabel("time of a frame, ms")
    axes[0].legend(fontsize=7)
    save(figure, "growth")


if __name__ == "__main__":
    for draw in (one_gain, sensors, radiance, peers, paper, night, input_size, trained_on_wraps, growth):
        draw()
