"""Whatever the array is: an answer of the right shape, or a ValueError. Memory does not grow, and other threads run."""

import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import modulo_camera as modulo

AnyArray = NDArray[Any]

DTYPES = ["u1", "u2", "f4", ">u2", ">f4", "f8", "f2", "i1", "i4", "u8", "?", "c8", "O", "U2", "M8[s]", "V3", "u1,f4"]


def contiguous(array: AnyArray) -> AnyArray:
    return array


def unaligned(array: AnyArray) -> AnyArray:
    if array.dtype.hasobject:
        return array
    memory = np.zeros(array.nbytes + 1, dtype=np.uint8)
    moved = memory[1:].view(array.dtype).reshape(array.shape) if array.nbytes else array
    moved[...] = array
    return moved


def field(array: AnyArray) -> AnyArray:
    """One field of a record: its strides are no multiple of the size of a sample."""
    records = np.zeros(array.shape, dtype=[("before", "u1"), ("sample", array.dtype)])
    records["sample"] = array
    return records["sample"]


def broadcast(array: AnyArray) -> AnyArray:
    return np.broadcast_to(array[:1], (3, *array.shape[1:])) if array.ndim and len(array) else array


def read_only(array: AnyArray) -> AnyArray:
    array.flags.writeable = False
    return array


LAYOUTS: list[Callable[[AnyArray], AnyArray]] = [
    contiguous,
    unaligned,
    field,
    broadcast,
    read_only,
    np.asfortranarray,
    np.transpose,
    np.flip,
    lambda array: array[::2] if array.ndim else array,
    lambda array: array[..., ::-1] if array.ndim else array,
    lambda array: np.repeat(array, 3, axis=-1)[..., ::3] if array.ndim else array,
    lambda array: array.view(np.matrix) if array.ndim == 2 else array,
]


@st.composite
def arrays(draw: st.DrawFn) -> AnyArray:
    """Arrays of any shape and type. Two of three have those of an image."""
    side = st.integers(1, 9)
    image = st.tuples(side, side) | st.tuples(side, side, st.sampled_from([1, 3]))
    odd = st.lists(st.integers(0, 5), max_size=5).map(tuple)
    shape = draw(st.one_of(image, image, odd))
    common = st.sampled_from(["u1", "u2", "f4"])
    dtype = np.dtype(draw(st.one_of(common, common, st.sampled_from(DTYPES))))
    size = int(np.prod(shape)) * dtype.itemsize
    if dtype.hasobject:
        array = np.full(shape, "object", dtype=object)
    else:
        seed = draw(st.integers(0, 2**32 - 1))
        array = np.frombuffer(np.random.default_rng(seed).bytes(size), dtype=dtype).reshape(shape).copy()
    if dtype == np.uint16 and draw(st.booleans()):
        array %= 256
    if dtype.kind == "f":
        # Random bits are mostly huge numbers, and half of the arrays shall be images.
        if draw(st.booleans()):
            array = np.random.default_rng(seed).uniform(0, 1.2, shape) * np.ones(shape)
            array = np.asarray(array, dtype=dtype)
        if array.size and draw(st.sampled_from([False, False, True])):
            array.flat[-1] = draw(st.sampled_from([np.nan, np.inf, -np.inf, -1.0, 0.5]))
    # Some functions of numpy make a number of an array without dimensions.
    return np.asanyarray(draw(st.sampled_from(LAYOUTS))(array))


# Possible and impossible values of each parameter.
PARAMETERS: dict[str, tuple[list[Any], list[Any]]] = {
    "bits": ([8, 8, 10, 16, 4, 1], [0, 17, -1]),
    "alpha": ([4.0, 1.0, 0.001, 256, 3.3], [0.0, -1.0, float("nan"), 300.0]),
    "method": ([*modulo.METHODS], ["magic"]),
    "threads": ([1, 2], [0, 257, -1]),
    "mosaic": (["none", "none", "none", "none", "rggb", "bggr", "grbg", "gbrg"], ["rgb"]),
    "gains": (["none", "checkerboard"], ["rows", "colours"]),
    "gain_ratio": ([0.0, 0.001], [1.0, -1.0, float("nan")]),
    "psf_sigma": ([None, 0.0, 0.5, 1.4, 9.0], [-1.0, float("inf")]),
    "psf": (["gaussian", "paper7", "perfect", "unknown"], ["box"]),
    "read_noise": ([0.0, 2.5, 65536.0], [-1.0]),
    "shot_noise": ([0.0, 1.0], [1e9]),
    "full_well_electrons": ([0.0, 1e-300, 1e4], [-1.0]),
    "prnu": ([0.0, 1.0], [2.0]),
    "hot_pixels": ([0.0, 1.0], [-0.5]),
    "modulus": ([1.0, 0.5, 1.5], [0.0, float("nan")]),
    "reset_loss": ([0.0, 2.5, 65536.0], [-1.0]),
    "reset_spread": ([0.0, 0.01, 1.0], [1.5]),
    "transfer": (["linear", "srgb", "gamma22", "rec709"], ["log"]),
    "headroom": ([1.0, 0.97, 0.001], [0.0, 1.1, float("nan")]),
    "optical_black": ([0, 1, 32, 64], [65, -1]),
    "seed": ([0, 2**63 - 1], [2**63, -1]),
    "white": ([0.0, 1e-40, 2.0, 4096.0, 1e12], [-1.0, float("nan")]),
    "black": ([0.0, 1e-40, 0.5, 64.0], [-1.0, 1e12, float("nan")]),
    "knees": (["", "1023:1023, 2559:4095, 3455:32767, 65535:65536"], ["5:5,4:9", "a:b", "1:1"]),
    "black_level": ([-1.0, 0.0, 340.0], [float("nan"), -2.0]),
    "tau": ([0.1, 0.0, 1e6], [float("nan")]),
    "threshold_on": (["phi", "rho"], ["both"]),
    "trust_lines": ([1e-5, 0.0, 1.0], [2.0]),
    "confidence": ([False, True], [False]),
}


def options(*names: str) -> st.SearchStrategy[dict[str, Any]]:
    """Some of the parameters. Most sets are possible, so that the arrays reach the core."""
    possible = {name: st.sampled_from(PARAMETERS[name][0]) for name in names}
    any_value = {name: st.sampled_from(PARAMETERS[name][0] + PARAMETERS[name][1]) for name in names}
    sets = [st.fixed_dictionaries({}, optional=values) for values in (possible, possible, possible, any_value)]
    return st.one_of(sets)


SENSOR = options(
    "bits", "alpha", "psf_sigma", "read_noise", "shot_noise", "mosaic", "gains", "seed", "psf", "gain_ratio",
    "full_well_electrons", "prnu", "hot_pixels", "modulus", "reset_loss", "reset_spread", "headroom", "transfer",
    "optical_black", "black_level", "white", "black", "knees",
)  # fmt: skip
UNWRAP = options("method", "confidence")
OPTIONS = options("threads", "tau", "threshold_on", "trust_lines")
AXES = st.sampled_from([-1, -1, -1, None, 0, 1, -3, 9])


def answered(call: Callable[[], Any]) -> Any:
    """The answer, or nothing when the call raises a ValueError; any other exception fails the test."""
    try:
        return call()
    except ValueError as why:
        assert str(why)
        return None


@settings(max_examples=1000, deadline=None, suppress_health_check=list(HealthCheck))
@given(array=arrays(), given=SENSOR, unwrap=UNWRAP, options=OPTIONS, axis=AXES)
def test_each_array_gets_an_answer_or_a_value_error(
    array: AnyArray, given: dict[str, Any], unwrap: dict[str, Any], options: dict[str, Any], axis: int | None
) -> None:
    sensor = answered(lambda: modulo.Sensor(**given))
    if sensor is None:
        return
    exposure = answered(lambda: sensor.expose(array, channel_axis=axis))
    shape, is_mosaic = array.shape, given.get("mosaic", "none") != "none"
    if exposure is not None:
        seen = shape if not is_mosaic or axis is None or array.ndim == 2 else tuple(np.delete(shape, axis))
        assert all(image.shape == seen for image in exposure)
        # An array that is an image is one for the other functions, too.
        result = answered(lambda: sensor.unwrap(exposure.modulo, **unwrap, options=options, channel_axis=axis))
        assert result is None or result.radiance.shape == result.counts.shape == seen
    result = answered(lambda: sensor.unwrap(array, **unwrap, options=options, channel_axis=axis))
    if result is not None:
        assert result.radiance.shape == result.counts.shape == shape
        assert given.get("gains", "none") != "none" or np.array_equal(
            result.radiance, np.asarray(array) + np.float32(2.0 ** given.get("bits", 8)) * result.counts
        )
    for function in (sensor.tone_map, sensor.deblur):
        image = answered(lambda: function(array, channel_axis=axis))
        assert image is None or (image.dtype == np.uint8 and image.size == array.size * (3 if is_mosaic else 1))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("dtype", ["u1", "u2", "f4"])
@pytest.mark.parametrize("shape", [(7, 9), (7, 9, 3)])
def test_the_layout_does_not_matter(shape: tuple[int, ...], dtype: str, layout: Callable[[AnyArray], AnyArray]) -> None:
    values = np.random.default_rng(1).integers(0, 250, shape)
    array = layout((values / 256).astype("f4") if dtype == "f4" else values.astype(dtype))
    plain = np.array(array, order="C")
    sensor = modulo.Sensor(psf_sigma=1, read_noise=2, white=0 if dtype == "f4" else 256)
    if plain.ndim == 3 and plain.shape[2] != 3:
        with pytest.raises(ValueError, match="channels"):
            sensor.expose(array)
        return
    for image, other in zip(sensor.expose(array), sensor.expose(plain), strict=True):
        assert np.array_equal(image, other)
    assert np.array_equal(sensor.tone_map(array), sensor.tone_map(plain))
    if dtype != "f4":
        assert np.array_equal(sensor.unwrap(array).radiance, sensor.unwrap(plain).radiance)


def test_what_is_not_possible_is_named_with_its_remedy() -> None:
    image = np.zeros((4, 6), dtype=np.float32)
    image[1, 2] = np.nan
    calls: list[tuple[Callable[[], object], str]] = [
        (lambda: modulo.Sensor().expose(image), "radiance at (row 1, column 2, channel 0) is NaN"),
        (lambda: modulo.Sensor().unwrap(np.zeros((4, 6), "f4")), "integers of 8 or 16 bits are needed"),
        (lambda: modulo.Sensor().unwrap(np.full((4, 6), 256, "u2")), "is 256, 0 to 255 is possible with 8 bits"),
        (lambda: modulo.Sensor().unwrap(np.zeros((4, 6), "i8")), "samples of type int64, uint8, uint16 or float32"),
        (lambda: modulo.Sensor().unwrap(np.zeros((4, 6, 2), "u1")), "codes has 2 channels along axis -1"),
        (lambda: modulo.Sensor().unwrap(np.zeros((0, 6), "u1")), "image of 0 x 6 pixels is empty"),
        (lambda: modulo.Sensor().unwrap(np.zeros(6, "u1")), "has 1 dimensions"),
        (lambda: modulo.Sensor(gains="checkerboard", gain_ratio=0.5), "at most 0.25 (1 / alpha)"),
        (lambda: modulo.Sensor(mosaic="rggb").tone_map(np.zeros((4, 1), "f4")), "cannot be a colour mosaic"),
        (lambda: modulo.Sensor().expose(np.full((4, 6), 4095, "u2")), "give the code of full scale as white"),
        (lambda: modulo.Sensor(bits="eight"), "parameter 'bits' = 'eight'"),  # type: ignore[arg-type]
        (lambda: modulo.Sensor(seed=2**64), "parameter 'seed'"),
        (lambda: modulo.Sensor(psf=None), "parameter 'psf' = None"),  # type: ignore[arg-type]
        (lambda: modulo.Sensor().unwrap(np.zeros((4, 6), "u1"), options={"Tau": 1}), "'Tau', possible are threads, tau"),
        (lambda: modulo.average_precision([], [], "simple"), "possible are easy, moderate, hard, all"),
        (lambda: modulo.read_bag("no such bag"), "no such bag"),
        (lambda: modulo.read_source("scene://dusk"), "dusk"),
    ]
    for call, text in calls:
        with pytest.raises(ValueError) as raised:
            call()
        assert text in str(raised.value)
    with pytest.raises(TypeError, match="numpy array is needed"):
        modulo.Sensor().unwrap([[0, 1]])  # type: ignore[arg-type]


@pytest.mark.parametrize("shape", [(1 << 20, 1 << 20, 3), (1 << 40, 1 << 20), ((1 << 27) + 1, 1), (2, 1 << 61, 1)])
def test_a_huge_array_is_refused_before_it_is_copied(shape: tuple[int, ...]) -> None:
    try:
        array = np.broadcast_to(np.uint8(0), shape)
    except ValueError:
        pytest.skip("numpy itself has no array of this size")
    sensor = modulo.Sensor()
    for call in (sensor.expose, sensor.unwrap, sensor.tone_map, sensor.deblur):
        with pytest.raises(ValueError, match="cut it into tiles"):
            call(array)


def resident() -> int:
    """The memory of this process in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
def test_ten_thousand_calls_leave_no_memory() -> None:
    radiance = np.random.default_rng(1).random((24, 32, 3), dtype=np.float32)
    box = modulo.Detection(0, 0, 30, 30, 0.5, "car")

    def round() -> None:
        sensor = modulo.Sensor(psf_sigma=1, read_noise=1)
        found = sensor.unwrap(sensor.expose(radiance[::-1]).modulo, confidence=True).radiance
        sensor.tone_map(found)
        sensor.deblur(found)
        answered(lambda: sensor.unwrap(found))  # type: ignore[arg-type]
        modulo.average_precision([[box]], [[modulo.GroundTruth(0, 0, 30, 30, "car")]])
        next(modulo.read_source("scene://day?frames=1&width=32&height=24"))

    for _ in range(500):
        round()
    before = resident()
    for _ in range(10_000):
        round()
    # One array of 24 x 32 x 3 bytes for each call would be 23 MB.
    assert resident() - before < 4e6


def test_other_threads_run_while_an_image_is_unwrapped() -> None:
    sensor = modulo.Sensor()
    codes = sensor.expose(np.random.default_rng(1).random((2400, 2400), dtype=np.float32)).modulo
    worker = threading.Thread(target=sensor.unwrap, args=(codes, "spud"))
    worker.start()
    ticks = 0
    while worker.is_alive():
        time.sleep(1e-3)
        ticks += 1
    # A call that kept the lock of Python would let this loop run once or twice: before it and after it.
    assert ticks > 5


def test_another_thread_may_write_the_array_during_a_call() -> None:
    radiance = np.random.default_rng(1).random((400, 600, 3), dtype=np.float32)
    sensor = modulo.Sensor(psf_sigma=1)
    codes = sensor.expose(radiance).modulo
    found = sensor.unwrap(codes).radiance
    calls: list[tuple[Callable[[AnyArray], AnyArray], AnyArray]] = [
        (lambda array: sensor.expose(array).modulo, radiance),
        (lambda array: modulo.Sensor(white=2).expose(array).modulo, radiance),
        (lambda array: sensor.unwrap(array).radiance, codes),
        (sensor.tone_map, found),
        (sensor.deblur, found),
    ]
    # The writer runs as soon as the call releases the lock of Python, and not before.
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1000)
    try:
        for call, array in calls:
            expected = call(array)
            for _ in range(5):
                given = array.copy()
                begin = threading.Event()

                def write(given: AnyArray = given, begin: threading.Event = begin) -> None:
                    begin.wait()
                    given.fill(0)

                writer = threading.Thread(target=write)
                writer.start()
                begin.set()
                result = call(given)
                writer.join()
                assert np.array_equal(result, expected)
                assert not given.any()
    finally:
        sys.setswitchinterval(interval)


def test_the_number_of_threads_does_not_matter() -> None:
    sensor = modulo.Sensor()
    codes = sensor.expose(np.random.default_rng(1).random((90, 80, 3), dtype=np.float32)).modulo
    for method in modulo.METHODS:
        one, three = (sensor.unwrap(codes, method, options={"threads": threads}) for threads in (1, 3))
        assert np.array_equal(one.counts, three.counts)


def test_floats_of_64_bits_are_those_of_32() -> None:
    """The type of numpy's own floats was refused."""
    radiance = np.random.default_rng(2).random((16, 24))
    sensor = modulo.Sensor(alpha=4)
    wide, narrow = sensor.expose(radiance), sensor.expose(radiance.astype(np.float32))
    assert all((one == other).all() for one, other in zip(wide, narrow, strict=True))
    assert (sensor.tone_map(900 * radiance) == sensor.tone_map((900 * radiance).astype(np.float32))).all()


def test_a_sensor_shows_what_it_was_given() -> None:
    assert repr(modulo.Sensor()) == "Sensor(bits=8, alpha=4.0)"
    shown = repr(modulo.Sensor(10, 8, psf_sigma=1.4, mosaic="rggb"))
    assert shown == "Sensor(bits=10, alpha=8, psf_sigma=1.4, mosaic='rggb')"
    assert eval(f"modulo.{shown}").parameters == modulo.Sensor(10, 8, psf_sigma=1.4, mosaic="rggb").parameters
