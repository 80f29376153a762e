"""A simulated modulo camera sensor, the unwrapping of its images, and the detection and scoring of objects, on numpy arrays.

A modulo sensor of b bits wraps around where a normal one saturates: it delivers `codes = floor(radiance mod 2^b)`. Unwrapping finds
the wrap counts, so that `radiance = codes + counts 2^b` again.

>>> import numpy as np
>>> import modulo_camera as modulo
>>> sensor = modulo.Sensor(bits=8, alpha=4, psf_sigma=1.4)
>>> exposure = sensor.expose(np.tile(np.linspace(0, 1, 640, dtype=np.float32), (480, 1)))
>>> result = sensor.unwrap(exposure.modulo)
>>> bool((result.counts == exposure.counts).all()), result.report.trusted
(True, True)

Images are arrays H x W (grey) or H x W x C, where C is 1 (grey) or 3 (red, green, blue), of samples of the type `uint8`, `uint16` or
`float32`; `float64` is rounded to `float32`. Arrays of any strides are read; those in C order are not copied for it, except for integers that become a frame of
their own. A result of an image H x W is H x W. The methods `expose`, `unwrap`, `tone_map` and `deblur` of `Sensor` take batches, too.

*Code units*: one unit is one step of the sensor's converter, so that the peak is `2^bits` and radiance lies in
`[0, alpha 2^bits)`.

Parameters have the names, ranges and defaults of the nodes `modulo_camera`, `unwrap` and `detector`. What is not possible raises a
`ValueError` with the value and the remedy; an argument that is no array at all, a `TypeError`. While a function computes, other
threads of Python run. An image has at most 2^27 samples.
"""

import difflib
import functools
import inspect
import os
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from modulo_camera import _batch, _core, _evaluate

if TYPE_CHECKING:
    from modulo_camera._evaluate import Executor

__all__ = [
    "METHODS", "AveragePrecision", "Benchmark", "Codes", "Detection", "Exposure", "Frame", "GroundTruth",
    "Image", "Quality", "Report", "Scene", "Sensor", "Stability", "Unwrapped", "__version__",
    "average_precision", "benchmark", "detect", "draw", "evaluate", "read_bag", "read_source", "stability",
]  # fmt: skip

__version__: str = _core.__version__

METHODS: tuple[str, ...] = tuple(_core.METHODS)
"""The names of the unwrapping methods; docs/explanation/methods.md describes them."""

Codes: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]
"""Images of integer codes: `uint8` for 8 bits and less, else `uint16`."""

Image: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32] | NDArray[np.float64]
"""Images of any of the types of samples."""


# The networks that `detect` has loaded.
_network = functools.lru_cache(maxsize=4)(_core.Network)

# The parameters of a method that `Sensor.unwrap` takes as options.
_OPTIONS = ("threads", "tau", "threshold_on", "trust_lines", "trust_jumps")


class Exposure(NamedTuple):
    """The images of one exposure to the radiance x (code units), all with the same noise."""

    modulo: Codes
    """The codes of the modulo sensor, `floor(x mod 2^b)`."""
    saturated: Codes
    """The codes of a sensor that saturates, `floor(min(x, 2^b - 1))`, as `transfer` encodes them."""
    ideal: NDArray[np.uint8]
    """The whole range, neither wrapped nor clipped, in 8 bits: `floor(x)` as `tone_map` shows it."""
    counts: NDArray[np.uint8]
    """The true wrap counts, `floor(x / 2^b)`."""


class Quality(NamedTuple):
    """Measures of how far a modulo image departs from the assumptions of `lines`, over all channels."""

    residues: float
    """The share of the 2 x 2 loops around which the wrapped differences do not sum to 0."""
    steep: float
    """The share of the 2 x 2 loops whose wrapped mixed difference is above 3/8 of the peak."""
    clamped: float
    """The share of the samples whose count was out of range and was clamped."""
    jumps: float
    """The second differences of the result above one peak, per sample; only `auto` and `lines` compute them."""
    defects: float
    """The share of the samples that were left out as hot, dead or stuck; only `auto` looks for them."""


class Report(NamedTuple):
    """The report of a method on its own result."""

    method: str
    """The method used: the one that was asked for, the one that `auto` took, or that of the gains."""
    trusted: bool | None
    """Whether the method claims that the counts are right; `None` if it makes no claim."""
    reason: str | None
    """Why the method does not claim that the counts are right, in one sentence; `None` if it does, or makes no claim."""
    offset: str | None
    """The evidence for the absolute offset: `range`, `optical_black`, or `unknown`, with which all counts may be too small by the same
    number; `None` if the counts do not agree with each other, or if the method makes no claim."""
    quality: Quality | None
    """The quality metrics; `None` for a method that does not compute them."""
    confidence: NDArray[np.uint8] | None
    """255 where the counts are claimed to be right, else 0, H x W; `None` unless it was asked for."""


class Unwrapped(NamedTuple):
    """The result of unwrapping an image, or a batch of them."""

    radiance: NDArray[np.float32]
    """The radiance in code units, `codes + counts 2^b`, of the shape of the codes."""
    counts: NDArray[np.uint8]
    """The wrap counts, 0 to `ceil(alpha) - 1`, of the shape of the codes."""
    reports: tuple[Report, ...]
    """The report of the method on each image, in C order of the axes of a batch; one for a single image."""

    @property
    def report(self) -> Report:
        """The report on the only image; a `ValueError` if there are several or none."""
        if len(self.reports) != 1:
            raise ValueError(f"the batch has {len(self.reports)} reports, not one; use reports")
        return self.reports[0]


class GroundTruth(NamedTuple):
    """A labelled object."""

    x1: float
    """The left edge of the box in px; pixel 0 covers [0, 1)."""
    y1: float
    """The upper edge in px."""
    x2: float
    """The right edge in px."""
    y2: float
    """The lower edge in px."""
    class_name: str
    """The class in lower case; `dontcare` is an area to leave out."""
    truncated: float = -1.0
    """The share of the object outside the image, 0 to 1; -1 if it is unknown."""
    occluded: int = -1
    """0 visible, 1 partly occluded, 2 largely occluded, 3 unknown, 4 a crowd, which is an area; -1 if it is not told."""


class Detection(NamedTuple):
    """An object that a detector has found."""

    x1: float
    """The left edge of the box in px; pixel 0 covers [0, 1)."""
    y1: float
    """The upper edge in px."""
    x2: float
    """The right edge in px."""
    y2: float
    """The lower edge in px."""
    score: float
    """The confidence, 0 to 1."""
    class_name: str
    """The class, as in the labels."""


class Frame(NamedTuple):
    """A recorded or rendered frame."""

    image: Image
    """The codes of a bag as they were recorded, or the radiance of a source; H x W or H x W x 3."""
    name: str
    """The name of the file without its extension, or the stamp in a bag."""
    stamp_ns: int | None
    """The time of exposure in ns since the epoch, if it is known."""
    frame_id: str
    """The coordinate frame."""
    mosaic: str
    """The colour filters of the pixels: none, rggb, bggr, grbg or gbrg."""
    ground_truth: list[GroundTruth] | None
    """The labelled objects; `None` for a frame without labels."""


class AveragePrecision(NamedTuple):
    """The average precision of one class, 0 to 1."""

    ap50: float
    """At an intersection over union of 0.5."""
    ap50_95: float
    """The mean over the thresholds 0.5, 0.55, ..., 0.95."""
    objects: int
    """The number of scored objects."""


class Sensor:
    """A modulo sensor behind a lens, with the noise of a camera. It simulates images, and unwraps those that it or a real one has taken.
    `parameters` has its arguments by name. Unlike those of the camera node, the defaults have neither a lens nor black columns, since
    an array may be smaller than these columns.

    Parameters
    ----------
    bits : int, in 1 to 16
        Bits of the sensor's converter. The peak is 2^bits code units.
    alpha : float, a finite number in 0.001 to 256
        Saturation factor: the brightest radiance of the scene divided by the sensor's peak.
    psf_sigma : float, a finite number in 0 to 100, or None
        Standard deviation of the gaussian lens blur in px. 0 is a perfect lens. Other shapes do not use it. None: no blur is simulated, and
        the lens of the codes is not known.
    read_noise : float, a finite number in 0 to 65536
        Standard deviation of the read noise in code units.
    shot_noise : float, a finite number in 0 to 65536
        Strength of the shot noise: its standard deviation at the signal x is sqrt(shot_noise * x) in code units.
    mosaic : str, one of none, rggb, bggr, grbg, gbrg
        Colour filters of a sensor with one chip, whose pixels see one colour each. none: each pixel sees all colours of the
        source. The images of a mosaic have the encoding bayer_*8 or bayer_*16. Images of one channel are raw mosaics of these
        filters, which are sensed as they are, without a lens. Here they are H x W.
    gains : str, one of none, checkerboard
        Pixels with a lower gain, which do not wrap: none, or every second one, as on a checkerboard.
    seed : int, in 0 to 9223372036854775807
        Seed of the noise. A sensor gives each frame the same noise; the camera adds the number of the frame to its seed.
    psf : str, one of gaussian, paper7, perfect, unknown
        Shape of the lens blur: gaussian with the width psf_sigma, paper7 for the paper's fixed 7 taps (about 1.4 px), perfect for
        no blur, or unknown for images that have the blur of a real lens. Images of raw mosaics always have the latter.
    gain_ratio : float, a finite number in 0 to 1
        The lower gain divided by the full one, at most 1 / alpha. 0: 1 / alpha.
    full_well_electrons : float, a finite number in 0 to 1000000000
        Electrons that fill the 2^bits codes of the converter at full gain (the saturation capacity of EMVA 1288). They add shot noise
        of the variance x * 2^bits / full_well_electrons. 0: only shot_noise.
    prnu : float, a finite number in 0 to 1
        Photo response non-uniformity (EMVA 1288): standard deviation of the gain between pixels, as a fraction. The pattern is the
        same in every frame.
    hot_pixels : float, a finite number in 0 to 1
        Share of the samples that are hot: their dark signal is evenly distributed up to the peak. The pattern is the same in every
        frame.
    modulus : float, a finite number in 0.5 to 1.5
        Mean charge at which a pixel resets itself, divided by 2^bits.
    reset_loss : float, a finite number in 0 to 65536
        Mean light that a pixel loses while it resets itself, in code units. Radiance has 2^bits of them from one reset of the mean
        pixel to the next, so that no error adds up.
    reset_spread : float, a finite number in 0 to 1
        Standard deviation between pixels of their modulus and reset_loss, as a fraction. The pattern is the same in every frame.
    headroom : float, a finite number in 0.001 to 1
        Full scale of the pictures of a source divided by alpha * 2^bits: the radiance of the largest code, the white of EXR and HDR
        images, or 1 in rendered frames. The images of 8 bits undo it, so that an ideal image is the picture that it comes from. 1: the
        brightest parts lie at the end of the range.
    transfer : str, one of linear, srgb, gamma22, rec709
        Transfer function of the pictures: codes of 8 and 16 bits of a source are decoded by it, and the images ideal, saturated and
        recovered are encoded by it. linear: codes are radiance. EXR, HDR and rendered frames hold radiance, which is not decoded.
    optical_black : int, in 0 to 64
        Columns at the left border that a field stop in front of the lens shades: the radiance is 0 in the first quarter of them, at
        least in one column, and rises linearly over the others. They show where the radiance is 0. 32 columns keep neighbouring
        samples within half a peak up to an alpha of 8.
    black_level : float, a finite number in -1 to 65536
        Radiance in code units that you promise the darkest pixels of each frame to have, as the pedestal of a data sheet, to
        1/32 of 2^bits. It shows unwrap the absolute level of a frame in which some pixels have it. -1: no promise.
    metering : str, one of mean, centre, highlights
        The pixels that decide the exposure of the images auto_exposed and metered: the mean of all of them, that of the centre, whose
        pixels count three times, or the highlights, of which 99.9 % shall not clip.
    metering_target : float, a finite number in 0.01 to 1
        Goal of the mean radiance and of that of the centre, divided by that of the largest code. 0.18 is the middle grey of
        photography.
    exposure_delay : int, in 1 to 10
        Frames of the image auto_exposed after which a measured frame takes effect.
    exposure_step : float, a finite number in 1 to 64
        Largest factor between the exposures of two frames of the image auto_exposed.
    white : float, a finite number in 0 to 1000000000000
        The value that becomes full scale, for radiance of the types float32 and uint16. 0: 1 for float32, and 65536 for uint16.
    black : float, a finite number in 0 to 1000000000000
        Value without light (the black level) in the images of a source, whose radiance is 0.
    knees : str, any value
        Knee points of the companded codes of raw images, CODE:VALUE with rising codes and linear values, as data sheets list them,
        such as 1023:1023, 2559:4095, 3455:32767, 3967:65535. The last value is full scale. Empty: transfer says what codes mean.

    Raises
    ------
    ValueError
        With the parameter, its value and the possible ones.

    Examples
    --------
    >>> import numpy as np
    >>> import modulo_camera as modulo
    >>> radiance = np.full((2, 3), 0.9, dtype=np.float32)
    >>> exposure = modulo.Sensor(alpha=4).expose(radiance)
    >>> int(exposure.modulo[0, 0]), int(exposure.counts[0, 0])  # 0.97 * 0.9 * 4 * 256 = 893 = 125 + 3 * 256
    (125, 3)
    >>> modulo.Sensor(alpha=2)
    Sensor(bits=8, alpha=2)
    >>> modulo.Sensor(bits=17)
    Traceback (most recent call last):
    ValueError: parameter 'bits' = 17: must be in 1 to 16
    """

    def __init__(
        self,
        bits: int = 8,
        alpha: float = 4.0,
        psf_sigma: float | None = None,
        read_noise: float = 0.0,
        shot_noise: float = 0.0,
        mosaic: str = "none",
        gains: str = "none",
        seed: int = 0,
        *,
        psf: str = "gaussian",
        gain_ratio: float = 0.0,
        full_well_electrons: float = 0.0,
        prnu: float = 0.0,
        hot_pixels: float = 0.0,
        modulus: float = 1.0,
        reset_loss: float = 0.0,
        reset_spread: float = 0.0,
        headroom: float = 0.97,
        transfer: str = "linear",
        optical_black: int = 0,
        black_level: float = -1.0,
        metering: str = "mean",
        metering_target: float = 0.18,
        exposure_delay: int = 2,
        exposure_step: float = 2.0,
        white: float = 0.0,
        black: float = 0.0,
        knees: str = "",
    ) -> None:
        given = {name: value for name, value in locals().items() if name != "self"}
        self.parameters: Mapping[str, Any] = MappingProxyType(given)
        self._sensor = _core.Sensor(given)

    def __repr__(self) -> str:
        defaults = inspect.signature(type(self)).parameters
        shown = (f"{name}={value!r}" for name, value in self.parameters.items() if name in ("bits", "alpha") or value != defaults[name].default)
        return f"{type(self).__name__}({', '.join(shown)})"

    def expose(self, radiance: Image, *, channel_axis: int | None = -1) -> Exposure:
        """Exposes the sensor to radiance.

        Parameters
        ----------
        radiance : array of float32, uint8 or uint16, H x W, H x W x C or a batch
            Floats are radiance relative to full scale (see `white` and `headroom`), clamped to [0, 1). Integers are codes of a picture, fractions of
            255 or 65536 (or of `white`), which `transfer` decodes. As in the camera, each code is moved at random within its interval, in the same way for each
            image, so that the counts do not lie on a grid; the largest code stands for full scale. A sensor with a
            mosaic takes 3 channels, or the one channel of a raw mosaic of the same colour filters.
        channel_axis : int or None
            The axis of the colours; `None`: the images are grey, and their rows and columns are the last two axes. An array of two axes
            is always grey. All axes that are not of the image are a batch of any shape. NCHW is 1 or -3.

        Returns
        -------
        Exposure
            The images modulo, saturated and ideal, and the true wrap counts, all of the shape of the radiance. Those of a mosaic have no axis of
            colours.

        Raises
        ------
        ValueError
            With the sample that is NaN or infinite, or the shape, type or axis that is not possible.

        Examples
        --------
        >>> import numpy as np
        >>> import modulo_camera as modulo
        >>> pictures = np.zeros((5, 3, 4, 6), dtype=np.uint8)
        >>> modulo.Sensor().expose(pictures, channel_axis=1).modulo.shape
        (5, 3, 4, 6)
        >>> modulo.Sensor(mosaic="rggb").expose(pictures, channel_axis=1).modulo.shape
        (5, 4, 6)
        """
        images = _batch.Images("radiance", radiance, channel_axis)
        return Exposure(*map(images.joined, zip(*images.each(self._sensor.expose))))

    def auto_expose(self, radiance: Image) -> tuple[Codes, float]:
        """Exposes the next frame of a normal camera of the same chip, whose exposure follows the frames before it.

        The sensor remembers its exposure from call to call. At the first frame, it has looked at the scene until its exposure settled.

        Parameters
        ----------
        radiance : array of float32, uint8 or uint16, H x W or H x W x C
            As in `expose`.

        Returns
        -------
        (Codes, float)
            The image auto_exposed, and its exposure: up to 1 its time as a fraction of that of the modulo sensor, above 1 its gain, at most 64.

        Raises
        ------
        ValueError
            As in `expose`.

        Examples
        --------
        >>> import numpy as np
        >>> import modulo_camera as modulo
        >>> camera = modulo.Sensor(alpha=4, metering_target=0.5)
        >>> image, exposure = camera.auto_expose(np.full((8, 8), 0.9, dtype=np.float32))
        >>> int(image[0, 0]), round(exposure, 2)  # half of the largest code
        (128, 0.14)
        """
        return self._sensor.auto_expose(radiance)

    def unwrap(
        self,
        codes: Codes,
        method: str = "auto",
        *,
        confidence: bool = False,
        options: Mapping[str, int | float | str] = MappingProxyType({}),
        channel_axis: int | None = -1,
    ) -> Unwrapped:
        """Recovers the radiance from modulo images of this sensor, or of a real one with these parameters.

        Parameters
        ----------
        codes : array of uint8 or uint16, H x W, H x W x C or a batch
            The codes of the modulo sensor, below 2^bits. More than 8 bits need uint16.
        method : str, one of auto, spud, least_squares, itoh, lines, tree, gradient_tree
            Unwrapping method. auto decodes by proof where the lens and the noise are described; else it tries lines, gradient_tree, a
            tree on smoothed codes, and growth of what is known (spud where noise hides all), until a result does not contradict itself.
            Images of a sensor with two gains (see gains) have a method of their own.
        confidence : bool
            Whether the reports shall have the confidence image. It takes longer than unwrapping by `lines`.
        options : mapping of str to int, float or str
            What is rarely set:

            - threads : int, in 1 to 64, 1.
              Number of threads that unwrapping may use. The result does not depend on it.
            - tau : float, a finite number in 0 to 1000000, 0.1.
              For spud: the hard threshold, in units of the peak.
            - threshold_on : str, one of phi, rho, phi.
              For spud: the threshold acts on the coefficients after the division (phi) or before it (rho).
            - trust_lines : float, a finite number in 0 to 1, 1e-05.
              For auto: the largest fraction of steep 2 x 2 loops with which it trusts a result in a single colour.
            - trust_jumps : float, a finite number in 0 to 2, 2e-05.
              For auto: the largest number of second differences of the result above one peak, per sample, with which it trusts a result.
        channel_axis : int or None
            As in `expose`. The codes of a mosaic have no axis of colours: their rows and columns are the last two axes.

        Returns
        -------
        Unwrapped
            The radiance in code units, the wrap counts, and the reports of the method.

        Raises
        ------
        ValueError
            With the parameter, the option, the axis or the code that is not possible, and for floats, which are no codes.

        Examples
        --------
        >>> import numpy as np
        >>> import modulo_camera as modulo
        >>> sensor = modulo.Sensor(alpha=4, psf_sigma=1)
        >>> exposure = sensor.expose(np.tile(np.linspace(0, 1, 640, dtype=np.float32), (480, 1)))
        >>> radiance, counts, (report,) = sensor.unwrap(exposure.modulo)
        >>> bool((counts == exposure.counts).all()), bool((radiance == exposure.modulo + 256.0 * counts).all())
        (True, True)
        >>> report.method, report.trusted, report.reason
        ('lines', True, None)
        >>> sensor.unwrap(exposure.modulo, options={"trust": 0.1})
        Traceback (most recent call last):
        ValueError: options has 'trust', possible are threads, tau, threshold_on, trust_lines, trust_jumps (did you mean 'trust_lines'?)
        """
        for name in options:
            if name not in _OPTIONS:
                near = [f" (did you mean {one!r}?)" for one in difflib.get_close_matches(str(name), _OPTIONS, 1, 0.4)]
                raise ValueError(f"options has {name!r}, possible are {', '.join(_OPTIONS)}{''.join(near)}")
        parameters = {**self.parameters, "method": method, **options}
        images = _batch.Images("codes", codes, self._colours(channel_axis))
        radiance, counts, reports = zip(*images.each(lambda image: _core.unwrap(image, parameters, confidence)))
        return Unwrapped(images.joined(radiance), images.joined(counts), tuple(map(_report, reports[: images.number])))

    def tone_map(self, radiance: Image, *, channel_axis: int | None = -1) -> NDArray[np.uint8]:
        """Returns radiance as images of 8 bits: `round(255 encode(radiance / (headroom alpha 2^bits)))`.

        encode is that of `transfer`; unless that is linear, half a code unit is added to the radiance, which holds whole codes.

        Parameters
        ----------
        radiance : array of float32, uint8 or uint16, H x W, H x W x C or a batch
            The radiance in code units, such as `Unwrapped.radiance`. NaN becomes 0.
        channel_axis : int or None
            As in `expose`. The radiance of a mosaic has no axis of colours, but the result has: the last one, if this is `None`.

        Returns
        -------
        array of uint8
            The images, of the shape of the radiance, with 3 channels for a mosaic.

        Raises
        ------
        ValueError
            With the shape, the type or the axis that is not possible.

        Examples
        --------
        >>> import numpy as np
        >>> import modulo_camera as modulo
        >>> radiance = np.array([[0, 512, 1024]], dtype=np.float32)
        >>> modulo.Sensor(bits=8, alpha=4).tone_map(radiance), modulo.Sensor(bits=8, alpha=4, transfer="srgb").tone_map(radiance)
        (array([[  0, 131, 255]], dtype=uint8), array([[  2, 190, 255]], dtype=uint8))
        """
        return self._picture(radiance, channel_axis, False)

    def deblur(self, radiance: Image, *, channel_axis: int | None = -1) -> NDArray[np.uint8]:
        """Returns radiance as images of 8 bits like `tone_map`, without the blur of the lens (a Wiener filter).

        Parameters
        ----------
        radiance : array of float32, uint8 or uint16, H x W, H x W x C or a batch
            As in `tone_map`.
        channel_axis : int or None
            As in `tone_map`.

        Returns
        -------
        array of uint8
            As of `tone_map`.

        Raises
        ------
        ValueError
            As of `tone_map`.

        Examples
        --------
        >>> import numpy as np
        >>> import modulo_camera as modulo
        >>> sensor = modulo.Sensor(psf_sigma=1)
        >>> edge = np.tile(np.repeat(np.float32([0.2, 0.8]), 16), (32, 1))
        >>> radiance = sensor.unwrap(sensor.expose(edge).modulo).radiance
        >>> blurred, sharp = sensor.tone_map(radiance), sensor.deblur(radiance)
        >>> bool(np.ptp(sharp[16, 15:17]) > np.ptp(blurred[16, 15:17]))
        True
        """
        return self._picture(radiance, channel_axis, True)

    def _picture(self, radiance: Image, channel_axis: int | None, deblur: bool) -> NDArray[np.uint8]:
        images, parameters = _batch.Images("radiance", radiance, self._colours(channel_axis)), dict(self.parameters)
        shown = images.each(lambda image: _core.picture(image, parameters, deblur))
        return images.joined(shown, -1 if channel_axis is None else channel_axis)

    def _colours(self, channel_axis: int | None) -> int | None:
        return channel_axis if self.parameters["mosaic"] == "none" else None


def detect(
    image: Codes | str | os.PathLike[str],
    model: str | os.PathLike[str] = "demo",
    *,
    threshold: float = 0.25,
    engine: str = "auto",
    device: str = "cpu",
) -> list[Detection]:
    """Finds objects in an image by a network, as the node `detector` and the command `modulo detect` do. `draw` shows them.

    A network is loaded by the first call with it, and kept for the next ones.

    Parameters
    ----------
    image : array of uint8, H x W or H x W x C, or path
        The image, or the path of its file (PNG, JPEG, TIFF, OpenEXR or Radiance HDR). A grey one is repeated to three channels.
    model : str or path
        Path of the ONNX model, or demo for the embedded demonstration model, which is not made for roads.
    threshold : float, a finite number in 0 to 1
        Detections with a lower score are not published.
    engine : str, one of auto, ort, openvino, openvino_f32, rten
        Inference engine: ONNX Runtime (ort), ONNX Runtime with OpenVINO (openvino, or openvino_f32 with 32 bits), rten, or
        auto: ort where its library is found, and rten elsewhere.
    device : str, any value
        Device that runs the model: cpu, cuda or tensorrt, the last two with ort only and with the number of a GPU where it is
        not the first, such as cuda:1. A device that is not there is an error.

    Returns
    -------
    list of Detection
        At most 300 objects with boxes in px of the image, the one with the best score first.

    Raises
    ------
    ValueError
        For a model that cannot be loaded or is no detector, an engine or a device that is not there, another image, and a file for the
        embedded model, which knows rendered scenes only.

    Examples
    --------
    >>> import modulo_camera as modulo
    >>> frame = next(modulo.read_source("scene://day?seed=2"))
    >>> modulo.detect(modulo.Sensor().expose(frame.image).ideal)[0].class_name
    'pedestrian'
    """
    if isinstance(image, str | os.PathLike) and os.fspath(model) == "demo":
        raise ValueError(f"{os.fspath(image)}: {_core.DEMO_LIMIT}, and give its path as model")
    found = _network(model=os.fspath(model), engine=engine, device=device).find(_picture(image), threshold)
    return [Detection(*one) for one in found]


def draw(image: Codes | str | os.PathLike[str], detections: Sequence[Detection]) -> NDArray[np.uint8]:
    """Returns an image with boxes, as the command `modulo detect` draws them. All other pixels are those of the image.

    Parameters
    ----------
    image : array of uint8, H x W or H x W x C, or path
        The image, or the path of its file.
    detections : sequence of Detection
        The boxes, with their classes and scores as labels. The first ones are drawn over the others.

    Returns
    -------
    array of uint8, H x W x 3
        A copy of the image in red, green and blue.

    Examples
    --------
    >>> import modulo_camera as modulo
    >>> frame = next(modulo.read_source("scene://day?seed=2"))
    >>> image = modulo.Sensor().expose(frame.image).ideal
    >>> modulo.draw(image, modulo.detect(image)).shape == image.shape
    True
    """
    return _core.draw(_picture(image), detections)


def _picture(image: Any) -> Any:
    """The image in the file that `image` names, or `image` itself."""
    return _core.read_image(os.fspath(image)) if isinstance(image, str | os.PathLike) else image


def read_bag(path: str | os.PathLike[str], source_topic: str = "") -> Iterator[Frame]:
    """Reads the images of a bag as they were recorded, with the labels of the same stamp.

    Parameters
    ----------
    path : path
        A `.mcap` file, or the folder of a bag. `modulo bag convert` makes one of a `.db3` file.
    source_topic : str, any value
        The image topic to read from a source that is a bag. Empty: the only image topic of the bag.

    Returns
    -------
    iterator of Frame
        The frames in the order of the recording. After an error the next call goes on with the image behind the bad one.

    Raises
    ------
    ValueError
        For a bag that cannot be read, or without this topic; while frames are read, for an image that cannot be decoded.

    Warns
    -----
    UserWarning
        For a bag that was cut: its whole chunks are read.

    Examples
    --------
    >>> import modulo_camera as modulo
    >>> frame = next(modulo.read_bag("bags/samples/tunnel"))
    >>> frame.image.shape, frame.image.dtype, frame.mosaic, len(frame.ground_truth)
    ((192, 640, 3), dtype('uint8'), 'none', 14)
    >>> modulo.Sensor(bits=8, alpha=4).unwrap(frame.image).report.method
    'lines'
    """
    return map(_frame, _core.Bag({"source": os.fspath(path), "source_topic": source_topic}))


def read_source(
    source: str | os.PathLike[str],
    white: float = 0.0,
    source_topic: str = "",
    *,
    transfer: str = "linear",
    black: float = 0.0,
    knees: str = "",
    mosaic: str = "none",
) -> Iterator[Frame]:
    """Reads the radiance of the frames that the camera would see, for `Sensor.expose`.

    Parameters
    ----------
    source : str or path
        A folder of images (png, jpg, tif, exr, hdr), one image, a video (mp4, mkv, avi, mov, webm, or `video:PATH`; needs ffmpeg), a KITTI
        folder, a bag, a spike recording (`PATH.npz?window=N`), or `scene://NAME?seed=N&frames=N&width=W&height=H` for a rendered
        scene: `day`, `tunnel`, `glare` or `night`.
    white : float, a finite number in 0 to 1000000000000
        Value that becomes full scale, for EXR, HDR and 16-bit images. 0: the 99.9th percentile of the first EXR or HDR image, and
        65536 for 16-bit images.
    source_topic : str, any value
        The image topic to read from a source that is a bag. Empty: the only image topic of the bag.
    transfer : str, one of linear, srgb, gamma22, rec709
        Transfer function of the pictures: codes of 8 and 16 bits of a source are decoded by it, and the images ideal, saturated and
        recovered are encoded by it. linear: codes are radiance. EXR, HDR and rendered frames hold radiance, which is not decoded.
    black : float, a finite number in 0 to 1000000000000
        Value without light (the black level) in the images of a source, whose radiance is 0.
    knees : str, any value
        Knee points of the companded codes of raw images, CODE:VALUE with rising codes and linear values, as data sheets list them,
        such as 1023:1023, 2559:4095, 3455:32767, 3967:65535. The last value is full scale. Empty: transfer says what codes mean.
    mosaic : str, one of none, rggb, bggr, grbg, gbrg
        Colour filters of a sensor with one chip, whose pixels see one colour each. none: each pixel sees all colours of the
        source. The images of a mosaic have the encoding bayer_*8 or bayer_*16. Images of one channel are raw mosaics of these
        filters, which are sensed as they are, without a lens. The frames of raw mosaics have one channel.

    Returns
    -------
    iterator of Frame
        The frames in their order; the images are float32 in [0, 1). A scene without `frames` has no end.

    Raises
    ------
    ValueError
        For a source that cannot be read; while frames are read, for an image that cannot be decoded.

    Warns
    -----
    UserWarning
        For labels that belong to no frame.

    Examples
    --------
    >>> import modulo_camera as modulo
    >>> frame = next(modulo.read_source("scene://glare?seed=4&width=320&height=96"))
    >>> frame.image.shape, frame.image.dtype, frame.ground_truth[0].class_name
    ((96, 320, 3), dtype('float32'), 'cyclist')
    """
    parameters: dict[str, float | str] = {
        "source": os.fspath(source),
        "white": white,
        "source_topic": source_topic,
        "transfer": transfer,
        "black": black,
        "knees": knees,
        "mosaic": mosaic,
    }
    return map(_frame, _core.Source(parameters))


def average_precision(
    detections: Sequence[Sequence[Detection]],
    ground_truth: Sequence[Sequence[GroundTruth]],
    difficulty: str = "moderate",
) -> dict[str, AveragePrecision]:
    """Scores detections by the average precision (AP) of each class, as COCO defines it.

    Detections take, by descending score, the free object of largest intersection over union of at least the threshold (one to one,
    at most 100 detections an image and class). AP is the mean precision at the recalls 0, 0.01, ..., 1.

    Parameters
    ----------
    detections : sequence of sequences of Detection
        The detections of each image.
    ground_truth : sequence of sequences of GroundTruth
        The objects of each image, in the same order.
    difficulty : str, one of easy, moderate, hard, all
        The objects that are scored, as in KITTI: moderate ones are at least 25 px high, at most partly occluded and 30 % outside the
        image. Objects beyond that are ignored, whether they are found or not. Detections lower than this that find nothing are
        ignored, too. all: every object, for labels without this information.

    Returns
    -------
    dict of str to AveragePrecision
        The scores of each class that has a scored object.

    Raises
    ------
    ValueError
        For another number of images, or a box or score that is not possible.

    Examples
    --------
    >>> import modulo_camera as modulo
    >>> truth = [modulo.GroundTruth(0, 0, 40, 40, "car"), modulo.GroundTruth(100, 0, 150, 40, "car")]
    >>> found = [modulo.Detection(1, 0, 40, 40, 0.9, "car"), modulo.Detection(300, 0, 340, 40, 0.8, "car")]
    >>> scores = modulo.average_precision([found], [truth])
    >>> scores["car"].objects, round(scores["car"].ap50, 3)
    (2, 0.505)
    """
    if len(detections) != len(ground_truth):
        raise ValueError(
            f"detections has {len(detections)} images and ground_truth {len(ground_truth)}; each image needs an entry in both"
        )
    scores = _core.average_precision(list(zip(detections, ground_truth)), difficulty)
    return {class_name: AveragePrecision(*score) for class_name, score in scores.items()}


def evaluate(
    file: str = "compare.launch.yaml",
    /,
    *,
    out: str | os.PathLike[str],
    vary: Mapping[str, Sequence[Any]] = MappingProxyType({}),
    arguments: Mapping[str, Any] = MappingProxyType({}),
    slices: Sequence[tuple[int, int]] = (),
    executor: "Executor | None" = None,
    program: str | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Runs `modulo eval` on a launch file, slice by slice, and returns the content of its `results.json`.

    Args:
        file: The launch file.
        out: The folder of the results, which every worker reaches by this path. What is there is not run again.
        vary: The values that launch arguments take by turns, such as `{"alpha": [2, 4]}`, or parameters of nodes, such as
            `{"unwrap.method": ["auto", "spud"]}`.
        arguments: Launch arguments with one value.
        slices: The frames of each call, by the first place and the place behind the last one. Empty: all frames in one call.
        executor: Runs the slices: anything with `submit(function, *arguments)` whose futures have `result()`, such as
            `concurrent.futures.ProcessPoolExecutor()`, `dask.distributed.Client()`, or `submitit.AutoExecutor(...)`.
        program: The path of the program where the workers find it. None: that of this package.
        **options: Options of `modulo eval`, such as `kitti="FOLDER"`, `source=["a", "b"]` or `jobs=1`.

    Raises:
        RuntimeError: The program ended with another exit code than 0 and 3.
    """
    return _evaluate.evaluate(file, out, vary, arguments, options, slices, executor, program)


def _report(fields: "_core._Report") -> Report:
    method, trusted, reason, offset, quality, confidence = fields
    return Report(method, trusted, reason, offset, quality and Quality(*quality), confidence)


def _frame(fields: "_core._Frame") -> Frame:
    image, name, stamp_ns, frame_id, mosaic, objects = fields
    ground_truth = None if objects is None else [GroundTruth(*one) for one in objects]
    return Frame(image, name, stamp_ns, frame_id, mosaic, ground_truth)


# At the end: both use what is above.
from modulo_camera._benchmark import Benchmark, benchmark
from modulo_camera._stability import Scene, Stability, stability
