"""`detect` finds what the detector node finds, with the embedded network and with any file."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import modulo_camera as modulo

MODELS = Path(__file__).parents[2] / "nodes/detector/tests/data"
SENSOR = modulo.Sensor(8, 4, psf_sigma=1.4)


def test_boxes_are_those_of_the_node(binary: Path, tmp_path: Path) -> None:
    source = "scene://glare?seed=4&frames=3"
    command: list[str | Path] = [binary, "eval", "--source", source, "--stream", "saturated,recovered", "--method", "auto", "--deblur", "off"]
    options: list[str | Path] = ["--alpha", "4", "--optical-black", "0", "--time-frames", "0", "--out", tmp_path]
    subprocess.run([*command, *options], check=True, capture_output=True)
    frames = list(modulo.read_source(source))
    cells = [json.loads(file.read_text()) for file in (tmp_path / "cells").glob("*.json")]
    assert sorted(cell["key"]["point"]["stream"] for cell in cells) == ["recovered", "saturated"]
    for cell in cells:
        for stored, frame in zip(cell["frames"], frames, strict=True):
            exposure = SENSOR.expose(frame.image)
            is_saturated = cell["key"]["point"]["stream"] == "saturated"
            picture = exposure.saturated if is_saturated else SENSOR.tone_map(SENSOR.unwrap(exposure.modulo).radiance)
            expected = sorted((score, name, *corners) for corners, score, name in stored["boxes"])
            found = sorted((one.score, one.class_name, *one[:4]) for one in modulo.detect(picture, threshold=0.001))
            assert [one[1] for one in found] == [one[1] for one in expected]
            assert np.allclose([one[:1] + one[2:] for one in found], [one[:1] + one[2:] for one in expected], rtol=0, atol=1e-4)


def test_objects_of_rendered_frames_are_found() -> None:
    sources = [f"scene://{name}?seed=7&frames=5" for name in ("day", "tunnel", "glare", "night")]
    frames = [frame for source in sources for frame in modulo.read_source(source)]
    exposures = [SENSOR.expose(frame.image) for frame in frames]
    truth = [frame.ground_truth or [] for frame in frames]
    recovered = [SENSOR.tone_map(SENSOR.unwrap(one.modulo).radiance) for one in exposures]
    scores = [modulo.average_precision(list(map(modulo.detect, images)), truth)["car"].ap50
              for images in (recovered, [one.modulo for one in exposures])]  # fmt: skip
    assert len(frames) == 20 and scores[0] > 0.95 > 0.8 > scores[1], scores


def test_a_file_a_grey_image_and_a_threshold_are_taken() -> None:
    grey = np.full((96, 160), 204, np.uint8)
    found = modulo.detect(grey, MODELS / "rows.onnx", engine="rten")
    assert found == modulo.detect(np.stack([grey] * 3, axis=-1), MODELS / "rows.onnx", engine="rten")
    assert [one.score for one in found] == sorted((one.score for one in found), reverse=True)
    for threshold in (0.0, found[1].score, 1.0):
        again = modulo.detect(grey, MODELS / "rows.onnx", threshold=threshold, engine="rten")
        assert [one for one in again if one.score >= 0.25] == [one for one in found if one.score >= threshold]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"model": "none.onnx"}, "model 'none.onnx'"),
        ({"model": MODELS / "mono.onnx"}, "needed is exactly one input"),
        ({"model": __file__}, "cannot load it"),
        ({"threshold": 1.5}, "threshold is 1.5, 0 to 1 is possible"),
        ({"threshold": float("nan")}, "threshold is NaN"),
        ({"engine": "magic"}, "'engine' = 'magic'"),
        ({"device": "gpu"}, "must be cpu, cuda, tensorrt"),
        ({"image": np.zeros((64, 64, 3), np.float32)}, "image is no image of uint8; use tone_map"),
        ({"image": np.zeros((64, 64, 2), np.uint8)}, "image has 2 channels"),
        ({"image": "none.png", "model": MODELS / "rows.onnx"}, "none.png: no such path"),
        ({"image": MODELS, "model": MODELS / "rows.onnx"}, "no image in this folder"),
        ({"image": "scene://day?frames=1", "model": MODELS / "rows.onnx"}, "is not one image; read_source"),
        ({"image": "street.png"}, "knows rendered scenes"),
    ],
)
def test_what_is_no_model_or_image_is_named(arguments: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError) as raised:
        modulo.detect(**{"image": np.zeros((64, 64, 3), np.uint8), "engine": "rten", **arguments})  # type: ignore[arg-type]
    assert said in str(raised.value)


def test_a_file_is_read_and_boxes_are_drawn(tmp_path: Path) -> None:
    image = np.random.default_rng(1).integers(0, 256, (96, 160, 3), np.uint8)
    Image.fromarray(image).save(tmp_path / "a.png")
    model = MODELS / "rows.onnx"
    found = modulo.detect(tmp_path / "a.png", model, engine="rten")
    assert found and found == modulo.detect(str(tmp_path / "a.png"), model, engine="rten") == modulo.detect(image, model, engine="rten")
    drawn = modulo.draw(tmp_path / "a.png", found)
    assert (drawn == modulo.draw(image, found)).all() and (drawn != image).any()
    assert (drawn[70:] == image[70:]).all(), "below all boxes"
    assert (modulo.draw(image, []) == image).all()
    assert (modulo.draw(image[..., 0], []) == image[..., :1]).all(), "grey becomes three colours"
