"""Bags and sources are read with their labels, and detections are scored."""

import itertools
import json
import pickle
from pathlib import Path

import numpy as np
import pytest

import modulo_camera as modulo

ROOT = Path(__file__).parents[2]

SAMPLE = ROOT / "bags/samples/tunnel"


def test_a_bag_has_its_codes_stamps_and_labels() -> None:
    frames = list(modulo.read_bag(SAMPLE, source_topic="/modulo"))
    assert len(frames) == 12
    rendered = modulo.read_source("scene://tunnel?seed=3&frames=12")
    sensor = modulo.Sensor(8, 4, psf_sigma=1.4, optical_black=32)
    for frame, scene in zip(frames, rendered, strict=True):
        # The camera of this recording had no noise, so that its codes come again.
        assert np.array_equal(frame.image, sensor.expose(scene.image).modulo)
        assert frame.stamp_ns is not None and frame.name == str(frame.stamp_ns)
        assert frame.ground_truth is not None and scene.ground_truth is not None
        assert [one.class_name for one in frame.ground_truth] == [one.class_name for one in scene.ground_truth]


def test_a_cut_bag_warns_and_gives_its_whole_chunks(tmp_path: Path) -> None:
    whole = (SAMPLE / "tunnel_0.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.warns(UserWarning):
        frames = list(modulo.read_bag(cut))
    assert 0 < len(frames) < 12


def test_a_bag_of_sqlite_names_the_command_that_converts_it(tmp_path: Path) -> None:
    bag = tmp_path / "old.db3"
    bag.write_bytes(b"SQLite format 3\0")
    with pytest.raises(ValueError, match="modulo bag convert"):
        list(modulo.read_bag(bag))


def test_labels_of_a_source_score_themselves() -> None:
    frames = list(itertools.islice(modulo.read_source("scene://day?seed=2"), 3))
    truth = [frame.ground_truth or [] for frame in frames]
    found = [[modulo.Detection(*one[:4], 0.9, one.class_name) for one in objects] for objects in truth]
    scores = modulo.average_precision(found, truth)
    assert scores and all(score.ap50 == score.ap50_95 == 1.0 for score in scores.values())
    assert all(score.ap50 == 0.0 for score in modulo.average_precision([[], [], []], truth).values())


def edges(row: list[float]) -> tuple[float, float, float, float]:
    """The edges of x, y, width and height, which are added in single precision as in the Rust test."""
    x, y, width, height = np.array(row[:4], dtype=np.float32)
    return float(x), float(y), float(x + width), float(y + height)


def test_scores_are_those_of_pycocotools() -> None:
    """The same expected values as for the Rust crate, by tests/peers/coco_reference.py."""
    cases = json.loads((ROOT / "eval/ap/tests/data/coco_golden.json").read_text())
    for case in cases:
        found = [[modulo.Detection(*edges(row), row[4], "car") for row in image["found"]] for image in case["images"]]
        truth = [
            # A crowd has the occlusion 4.
            [modulo.GroundTruth(*edges(row), "car", 0.0, 4 if row[4] else 0) for row in image["truth"]]
            for image in case["images"]
        ]
        score = modulo.average_precision(found, truth, "all")["car"]
        assert (score.ap50, score.ap50_95) == pytest.approx((case["ap50"], case["ap50_95"]), abs=1e-6)


def test_boxes_and_scores_that_are_not_possible_are_named() -> None:
    truth = modulo.GroundTruth(0, 0, 9, 9, "car")
    for box, text in [
        (modulo.Detection(9, 0, 0, 9, 0.5, "car"), "x1 <= x2"),
        (modulo.Detection(float("nan"), 0, 0, 9, 0.5, "car"), "finite numbers"),
        (modulo.Detection(0, 0, 9, 9, 1.5, "car"), "score is 1.5"),
    ]:
        with pytest.raises(ValueError, match=text):
            modulo.average_precision([[box]], [[truth]])
    with pytest.raises(ValueError, match="1 images and ground_truth 0"):
        modulo.average_precision([[]], [])


def test_results_can_be_pickled() -> None:
    result = modulo.Sensor().unwrap(np.zeros((4, 6), dtype=np.uint8))
    again = pickle.loads(pickle.dumps(result))
    assert np.array_equal(again.radiance, result.radiance) and again.report == result.report


def test_a_report_has_a_reason_where_a_claim_is_refused() -> None:
    sensor, ramp = modulo.Sensor(psf_sigma=1.4), np.tile(np.linspace(0, 1, 96, dtype=np.float32), (64, 1))
    noise = np.random.default_rng(1).random((64, 96), dtype=np.float32)
    reports = sensor.unwrap(modulo.Sensor().expose(np.stack([ramp, 0.3 * ramp, noise]), channel_axis=None).modulo, channel_axis=None).reports
    assert [report.trusted for report in reports] == [True, False, False]
    reasons = [None, "the absolute level is unknown: no dark reference", "the wrap counts contradict each other"]
    assert [report.reason for report in reports] == reasons
    assert sensor.unwrap(ramp.astype(np.uint8), "spud").report.reason is None


def test_resets_of_a_real_sensor_are_counted_from_their_low_bits(spikes: Path) -> None:
    """A pixel of a spike camera resets at each photon count that fills it: the low bits of the number of resets are a modulo image."""
    (frame,) = modulo.read_source(f"{spikes}?window=200", white=32)
    resets = (32 * frame.image).astype(np.uint8)
    assert np.array_equal(resets, np.load(spikes)["spk"].sum(axis=0, dtype=np.uint8))
    for bits, alpha, least in [(3, 4.0, 0.997), (4, 2.0, 0.999)]:
        _, counts, (report,) = modulo.Sensor(bits, alpha).unwrap(resets % (1 << bits))
        assert (counts == resets >> bits).mean() >= least, bits
        assert not report.trusted, "with so few bits, nothing shows a wrong count"
