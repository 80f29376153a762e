"""`benchmark` and `stability`: the figures, what a method of a stranger may do wrong, and what is written."""

import csv
import math
import os
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import modulo_camera as modulo
from modulo_camera._benchmark import Benchmark, affine_fit, exactness
from modulo_camera._calls import checked

SENSOR = modulo.Sensor(8, 4, psf_sigma=1)
RAMP = np.tile(np.linspace(0, 1, 96, dtype=np.float32)[None, :, None], (48, 1, 3))


def rows(codes: Any, bits: int, alpha: float) -> Any:
    return np.unwrap(codes.astype(float), axis=1, period=2**bits)


def shifted(codes: Any, bits: int, alpha: float) -> Any:
    radiance, counts, _ = modulo.Sensor(bits, alpha).unwrap(codes)
    return radiance + 2.0**bits, counts.astype(int) + 1


def raises(codes: Any, bits: int, alpha: float) -> Any:
    raise KeyError("no such\nthing")


def other_shape(codes: Any, bits: int, alpha: float) -> Any:
    return codes[..., 0]


def nan(codes: Any, bits: int, alpha: float) -> Any:
    return np.where(codes == codes.flat[0], np.nan, codes)


def sleeps(codes: Any, bits: int, alpha: float) -> Any:
    time.sleep(100)


def aborts(codes: Any, bits: int, alpha: float) -> Any:
    os.kill(os.getpid(), 15)


def exits(codes: Any, bits: int, alpha: float) -> Any:
    raise SystemExit(3)


def writes(codes: Any, bits: int, alpha: float) -> Any:
    codes[:] = 0
    return codes.astype(float)


def test_what_is_wrong_is_named_and_the_rest_goes_on() -> None:
    wrong = {"raises": raises, "shape": other_shape, "nan": nan, "sleeps": sleeps, "aborts": aborts, "exits": exits,
             "nothing": lambda codes, bits, alpha: None, "parts": lambda codes, bits, alpha: (codes, codes + 0.5)}  # fmt: skip
    start = time.monotonic()
    result = modulo.benchmark({**wrong, "writes": writes}, [RAMP] * 5, [SENSOR], include=["auto"], time_limit_s=0.5)
    # Three frames in a row that take too long are the last ones that are tried.
    assert time.monotonic() - start < 30
    found = {cell["method"]: cell for cell in result.cells}
    said = {name: " ".join(found[name]["failures"]) for name in wrong}
    for name, words in [
        ("raises", "raised KeyError: 'no such\\nthing'"),
        ("shape", "returned radiance of the shape (48, 96), but the codes have (48, 96, 3)"),
        ("nan", "that are NaN or infinite"),
        ("sleeps", "took more than 0.5 s"),
        ("sleeps", "was given up after 3 frames in a row that took too long"),
        ("aborts", "ended its process with signal 15"),
        ("exits", "raised SystemExit: 3"),
        ("nothing", "returned an object of type NoneType as radiance, but an array of numbers is needed"),
        ("parts", "returned counts with samples that are no integers"),
    ]:
        assert words in said[name], said[name]
        assert words in str(result)
    assert all(found[name]["unanswered"] == 5 and found[name]["exact_k"] == 0 for name in wrong)
    assert found["sleeps"]["failures"]["took more than 0.5 s"] == 3
    assert found["writes"]["unanswered"] == found["auto"]["unanswered"] == 0
    # No method is told the lens, and a ramp has no edge that would show it.
    assert found["auto"]["exact_k"] == 1 and found["auto"]["trusted"] == 0 and found["auto"]["trusted_wrong"] == 0


def test_figures() -> None:
    result = modulo.benchmark({"rows": rows, "shifted": shifted}, [RAMP], [SENSOR], include=["lines"])
    found = {cell["method"]: cell for cell in result.cells}
    assert found["rows"]["exact_k"] == found["lines"]["exact_k"] == 1
    assert found["shifted"]["exact_k"] == 0 and found["shifted"]["up_to_offset"] == 1
    # The offset is part of the fit. Whole codes are off by up to one: a variance of 1 / 12.
    whole = 10 * math.log10(1024**2 * 12)
    for cell in found.values():
        assert abs(cell["psnr_db"] - whole) < 0.3 and cell["ssim"] > 0.999
        assert cell["frame_ms"]["p50"] > 0 and cell["frame_ms"]["cpu_ms"] > 0
    assert found["lines"]["trusted"] is None and found["shifted"]["trusted"] is None


def test_without_a_limit_methods_run_in_this_process() -> None:
    processes = []

    def here(codes: Any, bits: int, alpha: float) -> Any:
        processes.append(os.getpid())
        return writes(codes, bits, alpha)

    result = modulo.benchmark({"here": here, "raises": raises}, RAMP, [SENSOR], include=["lines"], time_limit_s=None)
    assert set(processes) == {os.getpid()}
    # A method that writes into its image does not change that of the next.
    assert [cell["exact_k"] == 1 for cell in result.cells] == [False, False, True]


def test_offsets_and_fits() -> None:
    truth = np.zeros((10, 10, 3), np.uint8)
    counts = np.array([0, 4, -2]) + np.zeros((10, 10, 3), np.int64)
    counts[0, 0, 1] = 0
    assert exactness(counts, truth) == (101 / 300, 299 / 300)
    x = np.random.default_rng(1).random((6, 7, 3))
    assert np.allclose(affine_fit(x.astype(np.float32), -3 * x + [1, 2, 3]), -3 * x + [1, 2, 3], atol=1e-5)
    assert np.allclose(affine_fit(np.zeros((2, 2), np.float32), np.array([[1.0, 2], [3, 4]])), 2.5)


def test_counts_that_are_not_returned_are_the_nearest() -> None:
    y = np.array([[3, 250]], np.uint8)
    assert checked(np.array([[3 + 512 - 100, 250 + 100.0]]), y, 8)[1].tolist() == [[2, 0]]
    with pytest.raises(ValueError, match="returned an array of complex128 as radiance"):
        checked(y.astype(complex), y, 8)


def figures(result: Benchmark) -> list[Any]:
    """The rows without their times."""
    return [[value for name, value in row.items() if name not in ("ms", "cpu_ms")] for row in result.rows]


def test_a_run_goes_on_where_it_was_ended(tmp_path: Path) -> None:
    calls = tmp_path / "calls"

    def counted(codes: Any, bits: int, alpha: float) -> Any:
        with open(calls, "a") as file:
            file.write("x")
        return rows(codes, bits, alpha)

    def run() -> Benchmark:
        return modulo.benchmark({"mine": counted}, [RAMP, RAMP[::-1, ::-1]], [SENSOR], include=["lines"], out=tmp_path, repeats=1)

    first = run()
    assert calls.read_text() == "x" * 5
    second = run()
    assert calls.read_text() == "x" * 5 and second.rows == first.rows
    # A line that was cut is measured again, and what is behind it stays readable.
    file = tmp_path / "rows.jsonl"
    file.write_bytes(file.read_bytes()[:-20])
    third = run()
    assert figures(third) == figures(first)
    assert run().rows == third.rows and len(file.read_text().splitlines()) == 5

    def counted(codes: Any, bits: int, alpha: float) -> Any:  # type: ignore[no-redef]
        return rows(codes, bits, alpha) * 1.0

    # Another source of the same name is another method.
    assert run().rows[0]["ms"] != first.rows[0]["ms"]


def test_what_took_too_long_is_tried_again(tmp_path: Path) -> None:
    quick = tmp_path / "quick"

    def late(codes: Any, bits: int, alpha: float) -> Any:
        return rows(codes, bits, alpha) if quick.exists() else sleeps(codes, bits, alpha)

    def run() -> list[Any]:
        result = modulo.benchmark({"late": late}, [RAMP] * 4, [SENSOR], include=[], out=tmp_path / "out", repeats=1, time_limit_s=0.5)
        return [row["failure"] for row in result.rows]

    assert run() == ["took more than 0.5 s"] * 3 + ["was given up after 3 frames in a row that took too long"]
    quick.touch()
    assert run() == [None] * 4


def test_the_command_reads_what_is_written(binary: Path, tmp_path: Path) -> None:
    modulo.benchmark({"mine": rows}, [RAMP], [SENSOR, modulo.Sensor(8, 2, psf_sigma=1)], include=["auto"], out=tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["frames.csv", "results.json", "rows.jsonl"]
    with open(tmp_path / "frames.csv", newline="") as file:
        assert [(row["method"], row["exact"]) for row in csv.DictReader(file)] == [("mine", "1.0")] * 2 + [("auto", "1.0")] * 2
    subprocess.run([binary, "eval", "report", tmp_path], check=True, capture_output=True)
    assert "recovered (mine)" in (tmp_path / "report.html").read_text()


def test_results_never_replace_other_files(tmp_path: Path) -> None:
    own = tmp_path / "results.json"
    own.write_text("mine")
    with pytest.raises(FileExistsError, match="not empty"):
        modulo.benchmark({"mine": rows}, [RAMP], [SENSOR], include=[], out=tmp_path)
    with pytest.raises(FileExistsError, match="not empty"):
        modulo.benchmark({"mine": rows}, [RAMP], [SENSOR], include=[]).save(tmp_path)
    assert own.read_text() == "mine" and list(tmp_path.iterdir()) == [own]


def test_boxes_are_scored() -> None:
    frame = next(modulo.read_source("scene://glare?seed=4&width=320&height=96"))
    truth = [modulo.Detection(one.x1, one.y1, one.x2, one.y2, 0.9, one.class_name) for one in frame.ground_truth or []]

    def detect(image: Any) -> list[modulo.Detection]:
        assert image.shape == (96, 320, 3) and image.dtype == np.uint8
        return truth

    result = modulo.benchmark({"raises": raises}, frame, [SENSOR], include=["auto"], detect=detect, repeats=1)
    found = {cell["method"]: cell["ap50"] for cell in result.cells}
    assert found["auto"] and all(ap == 1 for ap in found["auto"].values()) and not any(found["raises"].values())
    with pytest.raises(ValueError, match="detect needs frames with labels"):
        modulo.benchmark({}, RAMP, detect=detect)


def test_tables_are_those_of_what_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    result = modulo.benchmark({}, RAMP, [SENSOR], include=["lines", "itoh"], repeats=1)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    table = result.table()
    assert [row["method"] for row in table] == ["lines", "itoh"] and table[0]["exact, %"] == 100
    assert len(result.table("sensor")) == 2 and result.table("frame")[0]["frame"] == "array 0"
    with pytest.raises(ValueError, match="by is 'frames', but must be one of method, sensor, frame"):
        result.table("frames")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"methods": {"lines": rows}}, "method 'lines' has the name of a method of the suite"),
        ({"methods": {"mine": 3}}, "method 'mine' is of type int, but must be a callable"),
        ({"include": ["magic"]}, "include has 'magic', but must have names out of auto"),
        ({"include": []}, "there is no method"),
        ({"sensors": [modulo.Sensor(mosaic="rggb")]}, "mosaic = rggb"),
        ({"sensors": [SENSOR, SENSOR]}, "two sensors with alpha 4, lens 1 px"),
        ({"sensors": []}, "sensors is empty"),
        ({"data": []}, "data has no frame"),
        ({"repeats": 0}, "repeats is 0, at least 1 is needed"),
        ({"time_limit_s": 0}, "time_limit_s is 0, but must be above 0"),
    ],
)
def test_what_is_not_possible_is_refused(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said.replace("(", r"\(")):
        modulo.benchmark(**{"methods": {}, "data": RAMP, **arguments})


def test_stability_says_what_only_a_method_solves() -> None:
    lines = modulo.stability(lambda codes, bits, alpha: modulo.Sensor(bits, alpha).unwrap(codes, "lines"))
    assert lines.only_here == [] and len(lines.solved) + len(lines.missed) <= len(lines.scenes)
    solved = [scene.name for scene in lines.scenes if scene.own.get("lines", 0) >= 0.999]
    # A mosaic is one channel for a method that is not told of it; all other scenes are seen as the suite sees them.
    other = {scene.name for scene in lines.scenes if scene.family == "Colour mosaics"}
    assert set(solved) - other == set(lines.solved) - other

    known = {scene.name: scene for scene in lines.scenes}
    assert "step_256" in known and not known["step_256"].observable

    def half(codes: Any, bits: int, alpha: float) -> Any:
        # The step of a whole peak, which no method can see.
        if codes.shape == (192, 320, 3) and np.ptp(codes) == 0:
            counts = np.zeros(codes.shape, int)
            counts[:, 160:] = 1
            return codes + 256.0 * counts, counts
        raise ValueError("unknown")

    found = modulo.stability(half)
    assert found.only_here == [name for name in found.solved if max(known[name].own.values()) < 0.999]
    assert "ValueError: unknown" in str(found)
