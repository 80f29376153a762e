"""A batch gives what a loop over its images gives, whatever its axes are."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import modulo_camera as modulo

AnyArray = NDArray[Any]


@settings(max_examples=200, deadline=None)
@given(
    batch=st.lists(st.integers(0, 3), max_size=3).map(tuple),
    channels=st.sampled_from([None, 1, 3]),
    place=st.integers(0, 5),
    from_end=st.booleans(),
    mosaic=st.sampled_from(["none", "none", "rggb"]),
    seed=st.integers(0, 99),
)
def test_a_batch_is_a_loop(batch: tuple[int, ...], channels: int | None, place: int, from_end: bool, mosaic: str, seed: int) -> None:
    image = (6, 7) if channels is None else (6, 7, channels)
    radiance = np.random.default_rng(seed).random(batch + image, dtype=np.float32)
    axis = None if channels is None else place % radiance.ndim - radiance.ndim * from_end
    sensor = modulo.Sensor(psf_sigma=0.5 if mosaic == "none" else 0, mosaic=mosaic, read_noise=1)

    def moved(array: AnyArray) -> AnyArray:
        """The images of a batch, with the axis of colours at its place."""
        return array if axis is None or array.ndim < radiance.ndim else np.moveaxis(array, -1, axis)

    def looped(results: list[AnyArray]) -> AnyArray:
        return moved(np.reshape(results, batch + results[0].shape))

    given = moved(radiance)
    exposure = sensor.expose(given, channel_axis=axis)
    result = sensor.unwrap(exposure.modulo, channel_axis=axis)
    shown = [function(result.radiance, channel_axis=axis) for function in (sensor.tone_map, sensor.deblur)]
    singles = [sensor.expose(radiance[index]) for index in np.ndindex(batch)]
    unwrapped = [sensor.unwrap(one.modulo) for one in singles]
    assert result.reports == tuple(one.report for one in unwrapped)
    if mosaic == "none":
        assert all(array.shape == given.shape for array in (*exposure, result.radiance, result.counts, *shown))
    assert [array.dtype for array in (*exposure, result.radiance, result.counts, *shown)] == ["u1"] * 4 + ["f4"] + ["u1"] * 3
    if singles:
        for number, whole in enumerate(exposure):
            assert np.array_equal(whole, looped([one[number] for one in singles]))
        assert np.array_equal(result.radiance, looped([one.radiance for one in unwrapped]))
        assert np.array_equal(result.counts, looped([one.counts for one in unwrapped]))
        for whole, function in zip(shown, (sensor.tone_map, sensor.deblur)):
            assert np.array_equal(whole, looped([function(one.radiance) for one in unwrapped]))


def test_a_report_of_a_batch_is_asked_for_by_its_place() -> None:
    result = modulo.Sensor().unwrap(np.zeros((2, 4, 6), np.uint8), channel_axis=None, confidence=True)
    assert [report.confidence is not None and report.confidence.shape for report in result.reports] == [(4, 6)] * 2
    with pytest.raises(ValueError, match="the batch has 2 reports, not one; use reports"):
        result.report


def test_what_is_no_batch_of_images_is_named() -> None:
    sensor = modulo.Sensor()
    for shape, axis, said in [
        ((4, 6, 2), -1, "codes has 2 channels along axis -1"),
        ((4, 4, 6, 5), 1, "codes has 4 channels along axis 1"),
        ((5, 4, 6), -1, "channel_axis=None takes a batch of grey images"),
        ((5, 3, 4, 6), 4, "channel_axis is 4, but codes has 4 axes; -4 to 3 or None is possible"),
        ((5, 3, 4, 6), -5, "channel_axis is -5"),
        ((5, 0, 6, 3), -1, "image of 0 x 6 pixels is empty"),
        ((0, 1 << 20, 1 << 20, 3), -1, "cut it into tiles"),
        ((6,), None, "codes has 1 dimensions"),
    ]:
        with pytest.raises(ValueError) as raised:
            sensor.unwrap(np.broadcast_to(np.uint8(0), shape), channel_axis=axis)
        assert said in str(raised.value)
    with pytest.raises(TypeError, match="integer"):
        sensor.expose(np.zeros((4, 6, 3), np.float32), channel_axis=1.5)  # type: ignore[arg-type]
