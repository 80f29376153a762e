"""Batches: the functions of the core take one image, and an array of any number of axes has one or many."""

import math
import operator
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Result = TypeVar("Result")
Sample = TypeVar("Sample", np.uint8, np.uint16, np.float32)


class Images:
    """The images of an array: H x W x C along `channel_axis`, or H x W without such an axis and in an array of two axes.

    Raises
    ------
    TypeError
        For what is no array, and for an axis that is no integer.
    ValueError
        For too few axes, an axis that the array does not have, and a number of channels other than 1 and 3.
    """

    def __init__(self, name: str, given: NDArray[Any], channel_axis: int | None) -> None:
        if not isinstance(given, np.ndarray):
            raise TypeError(f"{name} is of type {type(given)}, a numpy array is needed (numpy.asarray)")
        if given.ndim < 2:
            raise ValueError(f"{name} has {given.ndim} dimensions, at least height x width is needed")
        self._axis = None if channel_axis is None else operator.index(channel_axis)
        self._array, axes = given, 2
        if self._axis is not None and given.ndim > 2:
            if not -given.ndim <= self._axis < given.ndim:
                last = given.ndim - 1
                raise ValueError(f"channel_axis is {self._axis}, but {name} has {given.ndim} axes; -{last + 1} to {last} or None is possible")
            self._array, axes = np.moveaxis(given, self._axis, -1), 3
            if self._array.shape[-1] not in (1, 3):
                raise ValueError(
                    f"{name} has {self._array.shape[-1]} channels along axis {self._axis}, 1 (grey) or 3 (red, green, blue) are possible; "
                    "channel_axis=None takes a batch of grey images"
                )
        self._batch, self._image = self._array.shape[:-axes], self._array.shape[-axes:]
        self.number = math.prod(self._batch)
        """The number of images."""

    def each(self, call: Callable[[NDArray[Any]], Result]) -> list[Result]:
        """Returns what `call` gives for each image in C order; for an empty batch, what it gives for a black one, whose shape and type are known."""
        images = [self._array[index] for index in np.ndindex(self._batch)]
        return [call(image) for image in images or [np.broadcast_to(np.zeros((), self._array.dtype), self._image)]]

    def joined(self, results: Sequence[NDArray[Sample]], channel_axis: int | None = None) -> NDArray[Sample]:
        """Returns the results of `each` as one array of the axes of the batch, and of the colours of a result where those of the images are,
        or along `channel_axis`."""
        first, axis = results[0], self._axis if channel_axis is None else channel_axis
        array = np.stack(results)[: self.number].reshape(self._batch + first.shape) if self._batch else first
        return array if first.ndim == 2 or axis is None else np.moveaxis(array, -1, axis)
