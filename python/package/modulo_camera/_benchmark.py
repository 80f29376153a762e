"""`benchmark`: unwrapping methods of any origin on the same frames and sensors."""

import csv
import datetime
import hashlib
import importlib.util
import itertools
import json
import math
import os
import platform
import statistics
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from modulo_camera import METHODS, Detection, Frame, GroundTruth, Image, Sensor, __version__, _core
from modulo_camera import average_precision, read_source
from modulo_camera._calls import Call, Caller, Method, callables

Row: TypeAlias = dict[str, Any]

Detect: TypeAlias = Callable[[NDArray[np.uint8]], Sequence[Detection]]

Source: TypeAlias = str | os.PathLike[str] | Frame | Image

SCENES = tuple(
    f"scene://{name}?seed={seed}&frames=1&width=320&height=96" for name in ("day", "tunnel", "glare", "night") for seed in (1, 2)
)
"""The frames of a benchmark without data."""

# The sensors of a benchmark without sensors: alpha, lens blur in px, read noise in codes.
_SETTINGS = itertools.product((2.0, 4.0, 8.0), (0.0, 0.8, 1.4), (0.0, 5.0))
_SENSORS = tuple(_SETTINGS)

# The parameters of a sensor that are no axis of a benchmark.
_OF_SOURCE = ("seed", "white", "black", "knees")

# A method that has taken this many frames in a row too long is given up.
_TOO_LONG = 3

# From this time of a call on, a call is not repeated, ms.
_SLOW_MS = 200.0

# The share of exact counts from which trust is justified, as in the stability suite.
_RECOVERED = 0.999

_DEFINITIONS = {
    "exact_k": "Share of the samples of all channels with the true wrap count; no offset is forgiven. If a method returns only the "
    "radiance, its counts are those nearest to (radiance - codes) / 2^b. A frame without a result counts as 0.",
    "up_to_offset": "The same share after the whole number has been added to the counts of each channel that serves them best.",
    "psnr_db": "Mean over the frames with a result of the PSNR of the radiance in dB with the peak alpha 2^b, after the affine function of it that "
    "fits best in each channel (least squares), against the radiance behind the same lens without noise and quantisation; at most 120.",
    "ssim": "Mean SSIM of the same two radiances as linear images of 8 bits.",
    "trusted": "Share of the frames with a result that the method trusts; only methods of the suite make this statement.",
    "trusted_wrong": "Number of frames that the method trusts although less than 99.9 % of the counts are exact.",
    "frame_ms": "Median over the frames of the median wall-clock time of a call, in ms, with the median processor time of all its threads and child "
    "processes. The first call of each frame is not timed unless it takes more than 0.2 s, in which case it is the only one; that of a process is never timed.",
    "ap50": "AP at an intersection over union of 0.5 of each class of the labels, of the boxes that detect finds on the recovered images.",
    "failures": "Number of frames by the reason for which the method has no result.",
}

# The figures of a cell that `modulo eval` does not have. `modulo eval report` refuses figures that it does not know.
_OWN_FIGURES = ("sensor_name", "failures", "up_to_offset")


class Benchmark:
    """The results of `benchmark`."""

    rows: list[Row]
    """A row for each method, sensor and frame, in this order."""
    cells: list[Row]
    """A row for each method and sensor: the figures that `results` defines."""
    results: Row
    """The content of `results.json`, with the keys that `modulo eval report` reads."""

    def __init__(self, rows: list[Row], cells: list[Row], results: Row) -> None:
        self.rows, self.cells, self.results = rows, cells, results

    def table(self, by: str = "method") -> Any:
        """Returns the figures as a data frame.

        Parameters
        ----------
        by : str, one of method, sensor, frame
            A row for each method, for each method and sensor, or for each method, sensor and frame.

        Returns
        -------
        pandas.DataFrame, polars.DataFrame or list of dict
            The first of these packages that is installed gives the type; without both, it is a list with a dict for each row.

        Raises
        ------
        ValueError
            For another value of by.
        """
        rows = {"method": self._methods, "sensor": self._sensors, "frame": self._frames}
        if by not in rows:
            raise ValueError(f"by is {by!r}, but must be one of {', '.join(rows)}")
        table = rows[by]()
        for package in ("pandas", "polars"):
            if importlib.util.find_spec(package):
                return importlib.import_module(package).DataFrame(table)
        return table

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Writes `results.json` and `frames.csv`, which has all figures of each method, sensor and frame, into a folder.

        Parameters
        ----------
        folder : path
            The folder, which is created if it is missing. One that is there is empty, or that of the rows of this benchmark.

        Raises
        ------
        FileExistsError
            For a folder with other files.
        """
        place = _place(folder)
        (place / "results.json").write_text(json.dumps(self.results, indent=2) + "\n")
        frames = self._frames()
        with open(place / "frames.csv", "w", newline="") as file:
            writer = csv.DictWriter(file, list(frames[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(frames)

    def __str__(self) -> str:
        """A table in Markdown, with a row for each method."""
        digits = {"exact, %": 3, "up to offsets, %": 3, "PSNR, dB": 1, "SSIM": 3, "trusted, %": 0, "trusted and wrong": 0,
                  "AP50, %": 1, "ms": 1, "processor ms": 1, "without a result": 0}  # fmt: skip
        rows = self._methods()
        heads = [head for head in rows[0] if head == "method" or head in digits]
        if all(row["AP50, %"] is None for row in rows):
            heads.remove("AP50, %")
        lines = [heads, ["---"] * len(heads)]
        for row in rows:
            shown = [row[head] for head in heads[1:]]
            texts = ["-" if value is None else _below_100(value, digits[head]) for head, value in zip(heads[1:], shown)]
            lines.append([row["method"], *texts])
        failures = [f"{row['method']}: {row['why']}" for row in rows if row["why"]]
        return "\n".join(["| " + " | ".join(line) + " |" for line in lines] + [""] * bool(failures) + failures)

    def _repr_markdown_(self) -> str:
        return str(self)

    def _methods(self) -> list[Row]:
        names = list(dict.fromkeys(cell["method"] for cell in self.cells))
        return [_figures({"method": name}, [cell for cell in self.cells if cell["method"] == name]) for name in names]

    def _sensors(self) -> list[Row]:
        first = ("method", "alpha", "psf_sigma", "read_noise")
        return [_figures({**{key: cell[key] for key in first}, "sensor": cell["sensor_name"]}, [cell]) for cell in self.cells]

    def _frames(self) -> list[Row]:
        hidden = ("key", "detections")
        return [{key: value for key, value in row.items() if key not in hidden} for row in self.rows]


def benchmark(
    methods: Mapping[str, Method],
    data: Source | Iterable[Source] = SCENES,
    sensors: Sequence[Sensor] | None = None,
    *,
    include: Sequence[str] = METHODS,
    out: str | os.PathLike[str] | None = None,
    detect: Detect | None = None,
    frames: int = 20,
    repeats: int = 3,
    threads: int = 1,
    time_limit_s: float | None = 100.0,
) -> Benchmark:
    """Compares unwrapping methods of any origin with those of the suite, on the same frames and sensors.

    Each method runs in a process of its own, which is bound to `threads` processors. A method that raises, returns another shape, or NaN, takes
    too long, or ends its process has no result for the frame; the table names why, and the rest goes on.

    Parameters
    ----------
    methods : mapping of str to callable
        The methods by name, each a callable `f(codes, bits, alpha)` that returns the radiance in code units, or `(radiance, counts)` with
        the wrap counts. codes is H x W or H x W x 3 of `uint8` or `uint16`; the results have its shape.
    data : source or iterable of sources
        What `read_source` reads, a `Frame`, or an array of radiance as `Sensor.expose` takes it; or several of them. Without data, eight
        rendered scenes of 320 x 96.
    sensors : sequence of Sensor
        The sensors, without a mosaic and gains. Without sensors, all 18 combinations of alpha 2, 4 and 8, a lens blur of 0, 0.8 and 1.4 px, and
        a read noise of 0 and 5 codes, of 8 bits.
    include : sequence of str
        The methods of the suite that are measured as well.
    out : path
        A folder for the results (see `Benchmark.save`), and for each measured row (`rows.jsonl`). A run that is started
        again with the same folder measures only what is missing there.
    detect : callable
        Finds objects on an image of 8 bits, H x W x C, and returns a sequence of `Detection`. With it and labels of all frames, there is an AP50.
    frames : int, at least 1
        The largest number of frames of each source.
    repeats : int, at least 1
        Timed calls of each frame after the first one, which is not timed. A call of more than 0.2 s is not repeated.
    threads : int, at least 1
        The number of threads that methods of the suite may use, and of processors that any method may use.
    time_limit_s : float
        The limit of a call. `None` runs the methods in this process, without a limit and with all processors, as methods on a GPU need it.

    Returns
    -------
    Benchmark
        Rows and tables. Printed, it is a table in Markdown.

    Raises
    ------
    ValueError
        With the method, the sensor, the number or the source that is not possible.

    Examples
    --------
    >>> import numpy as np
    >>> import modulo_camera as modulo
    >>> ramp = np.tile(np.linspace(0, 1, 96, dtype=np.float32), (64, 1))
    >>> def rows(codes, bits, alpha):
    ...     return np.unwrap(codes.astype(float), period=2**bits)
    >>> result = modulo.benchmark({"rows": rows}, [ramp], [modulo.Sensor(alpha=4)], include=["lines"])
    >>> [(cell["method"], cell["exact_k"]) for cell in result.cells]
    [('rows', 1.0), ('lines', 1.0)]
    """
    for name, number in (("frames", frames), ("repeats", repeats), ("threads", threads)):
        if number < 1:
            raise ValueError(f"{name} is {number}, at least 1 is needed")
    if time_limit_s is not None and not 0 < time_limit_s < math.inf:
        raise ValueError(f"time_limit_s is {time_limit_s}, but must be above 0, or None for no limit")
    given = callables(dict(methods), list(include), threads)
    if sensors is None:
        sensors = [Sensor(8, alpha, blur, noise) for alpha, blur, noise in _SENSORS]
    named = _named(sensors)
    pictures = _pictures(data, frames)
    if detect and any(frame.ground_truth is None for frame in pictures):
        raise ValueError("detect needs frames with labels; leave it out, or take a source with labels")
    store = _Store(out)
    settings = {"repeats": repeats, "threads": threads}
    rows = _measure(given, named, pictures, store, settings, time_limit_s, detect)
    cells = [
        _cell(method, sensor, [row for row in rows if row["method"] == method and row["sensor"] == name], pictures, detect)
        for method in given
        for name, sensor in named.items()
    ]
    result = Benchmark(rows, cells, _results(cells, data, pictures, threads))
    if out is not None:
        result.save(out)
    return result


def _named(sensors: Sequence[Sensor]) -> dict[str, Sensor]:
    """Returns the sensors by their names."""
    named: dict[str, Sensor] = {}
    for sensor in sensors:
        one = sensor.parameters
        for parameter in ("mosaic", "gains"):
            if one[parameter] != "none":
                raise ValueError(f"sensors has a sensor with {parameter} = {one[parameter]}, but methods are told only bits and alpha; take none")
        lens = "unknown" if one["psf_sigma"] is None else f"{one['psf_sigma']:g} px"
        name = f"alpha {one['alpha']:g}, lens {lens}, read noise {one['read_noise']:g}"
        plain = Sensor().parameters
        for parameter, value in one.items():
            if parameter not in ("alpha", "psf_sigma", "read_noise") and value != plain[parameter]:
                name += f", {parameter.replace('_', ' ')} {value}"
        if name in named:
            raise ValueError(f"sensors has two sensors with {name}; one is enough")
        named[name] = sensor
    if not named:
        raise ValueError("sensors is empty; at least one sensor is needed")
    return named


def _pictures(data: Source | Iterable[Source], most: int) -> list[Frame]:
    """Returns the frames of all sources."""
    single = isinstance(data, (str, os.PathLike, Frame, np.ndarray))
    given: Any = data
    sources: list[Source] = [given] if single else list(given)
    found: list[Frame] = []
    for number, source in enumerate(sources):
        if isinstance(source, Frame):
            found.append(source)
        elif isinstance(source, np.ndarray):
            found.append(Frame(source, f"array {number}", None, "", "none", None))
        else:
            text = os.fspath(source)
            for frame in itertools.islice(read_source(text), most):
                # Frames of several scenes and folders have the same names.
                found.append(frame if single else frame._replace(name=f"{text.split('?')[0].rsplit('/', 1)[-1]} {number} {frame.name}"))
    if not found:
        raise ValueError("data has no frame; a source with at least one frame is needed")
    return found


def _place(folder: str | os.PathLike[str]) -> Path:
    """Returns a folder of results, which is new, empty, or that of a benchmark, since results never replace other files."""
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    if not (place / _ROWS).exists() and any(not entry.name.startswith(".") for entry in place.iterdir()):
        raise FileExistsError(f"{place} is not empty, and its files would mix with the results or be replaced; choose another folder")
    return place


_ROWS = "rows.jsonl"


class _Store:
    """The rows that are measured, in a file if there is a folder."""

    def __init__(self, out: str | os.PathLike[str] | None) -> None:
        self._file = None if out is None else _place(out) / _ROWS
        self._rows: dict[str, Row] = {}
        self._new: set[str] = set()
        if self._file:
            lines = self._file.read_text().splitlines() if self._file.exists() else []
            for line in lines:
                try:
                    row = json.loads(line)
                except ValueError:
                    # The last line of a run that was killed. Its frame is measured again.
                    continue
                self._rows[row["key"]] = row

    def get(self, key: str) -> Row | None:
        """Returns a row. What took too long is measured again: another limit, or a machine with less load, may suffice."""
        row = self._rows.get(key)
        return None if row is None or (_is_late(row) and key not in self._new) else row

    def add(self, row: Row) -> None:
        if self._file:
            with open(self._file, "a") as file:
                # Behind a line that was cut, a line of its own.
                file.write(("" if file.tell() == 0 or self._whole() else "\n") + json.dumps(row) + "\n")
        self._rows[row["key"]] = row
        self._new.add(row["key"])

    def _whole(self) -> bool:
        assert self._file
        with open(self._file, "rb") as file:
            file.seek(-1, os.SEEK_END)
            return file.read(1) == b"\n"


def _measure(
    methods: dict[str, tuple[Method, str]],
    sensors: dict[str, Sensor],
    pictures: list[Frame],
    store: _Store,
    settings: Row,
    time_limit_s: float | None,
    detect: Detect | None,
) -> list[Row]:
    """Returns the rows by method, sensor and frame. All methods have their turn with a frame, so that the load of the machine is the same."""
    digests = [hashlib.sha256(np.ascontiguousarray(frame.image).tobytes() + str(frame.image.shape).encode()).hexdigest() for frame in pictures]
    callers = {name: Caller(method, time_limit_s, settings["threads"]) for name, (method, _) in methods.items()}
    late = dict.fromkeys(methods, 0)
    total, done = len(methods) * len(sensors) * len(pictures), 0
    found: dict[tuple[str, str, int], Row] = {}
    try:
        for (sensor_name, sensor), (number, frame) in itertools.product(sensors.items(), enumerate(pictures)):
            exposed: _Exposed | None = None
            for name, (_, source) in methods.items():
                _show(done, total, f"{name}, {sensor_name}")
                described = [name, source, dict(sensor.parameters), digests[number], frame.name, settings, detect is not None]
                key = hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()[:24]
                row = store.get(key)
                if row is None:
                    exposed = exposed or _Exposed(sensor, frame.image)
                    call, ms, cpu_ms = _timed(callers[name], exposed, settings["repeats"], late[name])
                    first = {"method": name, "sensor": sensor_name, "frame": frame.name}
                    row = {**first, **exposed.score(call), "ms": ms, "cpu_ms": cpu_ms, "key": key}
                    row["detections"] = None
                    if detect and call.radiance is not None:
                        row["detections"] = [list(box) for box in detect(sensor.tone_map(call.radiance))]
                    store.add(row)
                late[name] = late[name] + 1 if _is_late(row) else 0
                found[name, sensor_name, number] = row
                done += 1
    finally:
        for caller in callers.values():
            caller.close()
        _show(done, total, "")
    return [found[place] for place in itertools.product(methods, sensors, range(len(pictures)))]


def _is_late(row: Row) -> bool:
    return str(row["failure"]).startswith(("took more", "was given up"))


def _timed(caller: Caller, exposed: "_Exposed", repeats: int, late: int) -> tuple[Call, float | None, float | None]:
    """Returns the result of a method for a frame with its median times."""
    if late >= _TOO_LONG:
        return Call(f"was given up after {_TOO_LONG} frames in a row that took too long"), None, None
    was_warm = caller.is_warm
    calls = [caller(exposed.codes, exposed.bits, exposed.alpha)]
    if calls[0].failure is None and not was_warm:
        calls = [caller(exposed.codes, exposed.bits, exposed.alpha)]
    if calls[0].failure is None and calls[0].ms < _SLOW_MS:
        calls = [caller(exposed.codes, exposed.bits, exposed.alpha) for _ in range(repeats)]
    for call in calls:
        if call.failure is not None:
            return call, None, None
    return calls[0], statistics.median(call.ms for call in calls), statistics.median(call.cpu_ms for call in calls)


class _Exposed:
    """A frame as a sensor sees it, with the truth."""

    def __init__(self, sensor: Sensor, radiance: Image) -> None:
        one = sensor.parameters
        self.bits, self.alpha = one["bits"], one["alpha"]
        self._linear = Sensor(**{**one, "transfer": "linear"})
        self.codes, _, _, self._counts = sensor.expose(radiance)
        # The radiance that a sensor of 16 bits without noise sees behind the same lens, in steps of 2^(bits - 16) codes.
        deviations = ("read_noise", "shot_noise", "full_well_electrons", "prnu", "hot_pixels", "reset_loss", "reset_spread")
        quiet = dict.fromkeys(deviations, 0.0) | {"modulus": 1.0}
        fine = Sensor(**{**one, **quiet, "bits": 16}).expose(radiance)
        self._truth = (fine.modulo + 65536.0 * fine.counts) / 2.0 ** (16 - self.bits)

    def score(self, call: Call) -> Row:
        """Returns the figures of a result."""
        row: Row = {"failure": call.failure, "exact": 0.0, "up_to_offset": 0.0, "psnr_db": None, "ssim": None, "trusted": None}
        if call.radiance is None or call.counts is None:
            return row
        fitted = affine_fit(call.radiance, self._truth)
        error = max(float(np.mean((fitted - self._truth) ** 2)), 1e-12 * (self.alpha * 2**self.bits) ** 2)
        row["exact"], row["up_to_offset"] = exactness(call.counts, self._counts)
        row["psnr_db"] = 10 * math.log10((self.alpha * 2**self.bits) ** 2 / error)
        row["ssim"] = _core.ssim(*(self._linear.tone_map(one.astype(np.float32)) for one in (fitted, self._truth)))
        row["trusted"] = call.trusted
        return row


def exactness(counts: NDArray[np.int64], truth: NDArray[np.uint8]) -> tuple[float, float]:
    """Returns the share of exact counts, and that share after the best offset for each channel."""
    off = np.atleast_3d(counts - truth.astype(np.int64))
    best = sum(int(np.unique(off[..., channel], return_counts=True)[1].max()) for channel in range(off.shape[2]))
    return float(np.mean(off == 0)), best / off.size


def affine_fit(radiance: NDArray[np.float32], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns a radiance + b with the a and b of each channel that make the squared error to the truth least."""
    samples, wanted = np.atleast_3d(radiance).astype(np.float64), np.atleast_3d(truth)
    centred, target = samples - samples.mean((0, 1)), wanted - wanted.mean((0, 1))
    power = (centred**2).mean((0, 1))
    scale = np.divide((centred * target).mean((0, 1)), power, out=np.zeros_like(power), where=power > 0)
    fitted: NDArray[np.float64] = scale * centred + wanted.mean((0, 1))
    return fitted.reshape(radiance.shape)


def _cell(method: str, sensor: Sensor, rows: list[Row], pictures: list[Frame], detect: Detect | None) -> Row:
    """Returns the figures of a method with a sensor."""
    answered = [row for row in rows if row["failure"] is None]
    failures: dict[str, int] = {}
    for row in rows:
        if row["failure"] is not None:
            failures[row["failure"]] = failures.get(row["failure"], 0) + 1
    claims = [row["trusted"] for row in answered if row["trusted"] is not None]
    times = sorted(row["ms"] for row in answered)
    scores = {}
    if detect:
        found = [[Detection(*box) for box in row["detections"] or []] for row in rows]
        truth: list[list[GroundTruth]] = [frame.ground_truth or [] for frame in pictures]
        scores = average_precision(found, truth)
    one = sensor.parameters
    return {
        "stream": "recovered",
        "method": method,
        "deblur": False,
        **{name: value for name, value in one.items() if name not in _OF_SOURCE},
        "model": "detect" if detect else "no detector",
        "input": "auto",
        "sensor_name": rows[0]["sensor"],
        "frames": len(rows),
        "unanswered": sum(failures.values()),
        "failures": failures,
        "exact_k": statistics.fmean(row["exact"] for row in rows),
        "up_to_offset": statistics.fmean(row["up_to_offset"] for row in rows),
        "exact_frames": statistics.fmean(row["exact"] == 1 for row in rows),
        "psnr_db": _mean(row["psnr_db"] for row in answered),
        "ssim": _mean(row["ssim"] for row in answered),
        "psnr_sharp_db": None,
        "ssim_sharp": None,
        "trusted": statistics.fmean(claims) if claims else None,
        "trusted_wrong": sum(row["trusted"] is True and row["exact"] < _RECOVERED for row in answered) if claims else None,
        "ap50": {name: score.ap50 for name, score in scores.items()},
        "ap50_95": _mean(score.ap50_95 for score in scores.values()),
        "objects": {name: score.objects for name, score in scores.items()},
        "classes": {name: score._asdict() for name, score in scores.items()},
        "frame_ms": _time(times, [row["cpu_ms"] for row in answered]) if times else None,
        # What only the command measures.
        "difficulty": {},
        "interval95": {},
        "latency_ms": {},
    }


def _time(times: list[float], cpu: list[float]) -> Row:
    """Returns the median time with the interval of its order statistics, of `times` in ascending order."""
    half = 0.98 * math.sqrt(len(times))
    low, high = max(0, math.floor(len(times) / 2 - half)), min(len(times) - 1, math.ceil(len(times) / 2 + half))
    return {"p50": statistics.median(times), "interval95": [times[low], times[high]], "cpu_ms": statistics.median(cpu), "frames": len(times)}


def _results(cells: list[Row], data: object, pictures: list[Frame], threads: int) -> Row:
    """Returns the content of `results.json`."""
    started = datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    host, processor = platform.node(), _processor()
    device = {"processor": processor, "engine": "python", "threads": threads}
    for cell in cells:
        cell["device"] = device
        if cell["frame_ms"]:
            cell["frame_ms"]["pass"] = f"{host} {started}"
    points = ("stream", "method", "deblur", "model", "input", *(name for name in Sensor().parameters if name not in _OF_SOURCE))
    source = data if isinstance(data, (str, os.PathLike)) else f"{len(pictures)} frames"
    digest = hashlib.sha256()
    for frame in pictures:
        digest.update(np.ascontiguousarray(frame.image).tobytes())
    labelled = sum(frame.ground_truth is not None for frame in pictures)
    drives: Row = {"drives": 0, "drawn": None, "warnings": [], "without_twin": {}}
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    run = {"command": "modulo.benchmark", "commit": "unknown", "host": host, "processor": processor, "started": started}
    return {
        "setup": {
            "version": __version__,
            "figures": 0,
            "protocol": "suite",
            "source": str(source),
            "bits": cells[0]["bits"],
            "seed": 0,
            "difficulty": "moderate",
            "engine": "python",
            "class_map": {},
            "groups": {},
            "models": {},
            "grid": [{name: cell[name] for name in points} for cell in cells],
        },
        "input": {"frames": len(pictures), "labelled": labelled, "digest": digest.hexdigest(), **drives},
        "definitions": _DEFINITIONS,
        "cells": [{name: value for name, value in cell.items() if name not in _OWN_FIGURES} for cell in cells],
        "runs": [{**run, "load": load, "wall_s": None}],
    }


def _figures(first: Row, cells: list[Row]) -> Row:
    """Returns a row of a table: means over cells, and sums of what is counted."""
    wrong = [cell["trusted_wrong"] for cell in cells if cell["trusted_wrong"] is not None]
    why: dict[str, int] = {}
    for reason, count in itertools.chain.from_iterable(cell["failures"].items() for cell in cells):
        why[reason] = why.get(reason, 0) + count
    precisions = [_mean(cell["ap50"].values()) for cell in cells]
    return {
        **first,
        "exact, %": _percent(_mean(cell["exact_k"] for cell in cells)),
        "up to offsets, %": _percent(_mean(cell["up_to_offset"] for cell in cells)),
        "PSNR, dB": _mean(cell["psnr_db"] for cell in cells),
        "SSIM": _mean(cell["ssim"] for cell in cells),
        "trusted, %": _percent(_mean(cell["trusted"] for cell in cells)),
        "trusted and wrong": sum(wrong) if wrong else None,
        "AP50, %": _percent(_mean(precisions)),
        "ms": _mean(cell["frame_ms"] and cell["frame_ms"]["p50"] for cell in cells),
        "processor ms": _mean(cell["frame_ms"] and cell["frame_ms"]["cpu_ms"] for cell in cells),
        "without a result": sum(cell["unanswered"] for cell in cells),
        "why": "; ".join(f"{reason} ({count} frame{'s' * (count > 1)})" for reason, count in why.items()),
    }


def _mean(values: Iterable[Any]) -> float | None:
    """Returns the mean of the values that are not `None`."""
    present = [float(value) for value in values if value is not None]
    return statistics.fmean(present) if present else None


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _below_100(value: float, digits: int) -> str:
    """Returns a number as text. One below 100 is never rounded to 100."""
    text = f"{value:.{digits}f}"
    return _below_100(value, digits + 1) if value < 100 and float(text) >= 100 and digits < 12 else text


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def _show(done: int, total: int, what: str) -> None:
    """Draws the progress bar, if somebody sees it."""
    if sys.stderr.isatty():
        filled = 24 * done // max(total, 1)
        bar = "#" * filled + "-" * (24 - filled)
        print(f"\r\x1b[K[{bar}] {done}/{total} {what[:60]}", end="" if what else "\n", file=sys.stderr, flush=True)
