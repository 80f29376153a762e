"""Images and results are bit for bit those of `modulo simulate`."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import modulo_camera as modulo


def pixels(path: Path) -> NDArray[np.uint8]:
    with Image.open(path) as image:
        return np.asarray(image, dtype=np.uint8)


def saved(out: Path, picture: Path, stream: str) -> NDArray[np.uint8]:
    return pixels(out / f"{picture.stem}_alpha4_{stream}.png")


def compare(binary: Path, out: Path, pictures: list[Path], methods: tuple[str, ...], mosaic: str, gains: str) -> None:
    """Compares each stream and each method on each picture."""
    options = ["--mosaic", mosaic, "--gains", gains, "--alpha", "4"]
    if gains == "none":
        options += ["--method", ",".join(methods)]
    noise = ["--psf-sigma", "1.4", "--optical-black", "0", "--read-noise", "1.5", "--shot-noise", "0.1", "--seed", "7"]
    subprocess.run([binary, "simulate", *pictures, *options, *noise, "--out", out], check=True, capture_output=True)
    rows = json.loads((out / "results.json").read_text())
    sensor = modulo.Sensor(8, 4, psf_sigma=1.4, read_noise=1.5, shot_noise=0.1, mosaic=mosaic, gains=gains, seed=7)
    assert len(rows) == len(pictures) * len(methods if gains == "none" else ["of the gains"])
    for row in rows:
        picture = Path(row["file"])
        exposure = sensor.expose(pixels(picture))
        assert np.array_equal(exposure.modulo, saved(out, picture, "modulo"))
        assert np.array_equal(exposure.saturated, saved(out, picture, "saturated"))
        if mosaic == "none":
            assert np.array_equal(exposure.ideal, saved(out, picture, "ideal"))
        method = row["method"] if gains == "none" else "auto"
        radiance, counts, (report,) = sensor.unwrap(exposure.modulo, method)
        assert np.array_equal(sensor.tone_map(radiance), saved(out, picture, row["method"])), row["method"]
        assert (report.method, report.trusted) == (row["method_used"], row["trusted"])
        if gains == "none":
            assert np.mean(counts == exposure.counts) == pytest.approx(row["exact_k"], rel=1e-12)


@pytest.fixture
def scenes(tmp_path: Path) -> list[Path]:
    """Two rendered scenes as pictures."""
    files = [tmp_path / "glare.png", tmp_path / "night.png"]
    for file in files:
        frame = next(modulo.read_source(f"scene://{file.stem}?seed=4&width=241&height=95"))
        Image.fromarray(modulo.Sensor().expose(frame.image).ideal).save(file)
    return files


@pytest.mark.parametrize(
    ("mosaic", "gains"),
    [("none", "none"), ("rggb", "none"), ("none", "checkerboard"), ("gbrg", "checkerboard")],
)
def test_rendered_scenes(binary: Path, scenes: list[Path], tmp_path: Path, mosaic: str, gains: str) -> None:
    compare(binary, tmp_path / "out", scenes, modulo.METHODS, mosaic, gains)


def test_kitti(binary: Path, kitti: list[Path], tmp_path: Path) -> None:
    compare(binary, tmp_path / "out", kitti, modulo.METHODS, "none", "none")


@pytest.mark.parametrize(("psf", "sigma"), [("gaussian", 0.0), ("perfect", None), ("gaussian", 1.4), ("unknown", None)])
def test_a_lens_has_the_same_trust(binary: Path, tmp_path: Path, psf: str, sigma: float | None) -> None:
    """Behind a perfect lens the codes do not show a step of two peaks: it is never trusted, and an unknown lens may be such a one."""
    picture, out = tmp_path / "step.png", tmp_path / "out"
    step = np.full((64, 96), 40, dtype=np.uint8)
    # A peak is 255 / (0.97 * 3) = 88 grey levels.
    step[16:48, 20:60] = 215
    Image.fromarray(step).save(picture)
    width = [] if sigma is None else ["--psf-sigma", str(sigma)]
    lens = ["--psf", psf, *width, "--alpha", "3", "--optical-black", "0"]
    subprocess.run([binary, "simulate", picture, *lens, "--out", out], check=True, capture_output=True)
    [row] = json.loads((out / "results.json").read_text())
    sensor = modulo.Sensor(8, 3, psf=psf, psf_sigma=sigma)
    exposure = sensor.expose(step)
    _, counts, (report,) = sensor.unwrap(exposure.modulo)
    assert report.trusted == row["trusted"]
    assert np.mean(counts == exposure.counts) == pytest.approx(row["exact_k"], rel=1e-12)
    assert not report.trusted or sigma == 1.4


@pytest.mark.parametrize("transfer", ["srgb", "rec709"])
def test_a_picture_returns_from_linear_light(transfer: str) -> None:
    picture = np.tile(np.arange(256, dtype=np.uint8), (64, 1))
    sensor = modulo.Sensor(bits=12, transfer=transfer)
    exposure = sensor.expose(picture)
    radiance = sensor.unwrap(exposure.modulo).radiance
    shown = sensor.tone_map(radiance)
    assert np.array_equal(shown, exposure.ideal)
    assert np.abs(shown.astype(int) - picture).max() <= 1
    assert not np.array_equal(modulo.Sensor(bits=12).tone_map(radiance), exposure.ideal)
