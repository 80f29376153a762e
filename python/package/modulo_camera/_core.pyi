"""The functions of the Rust crates. The package `modulo_camera` documents them and gives names to their results."""

from collections.abc import Iterator, Mapping, Sequence
from typing import final

from numpy import float32, uint8, uint16
from numpy.typing import NDArray

_Codes = NDArray[uint8] | NDArray[uint16]
_Image = NDArray[uint8] | NDArray[uint16] | NDArray[float32]
_Value = bool | int | float | str
_Quality = tuple[float, float, float, float, float]
_Report = tuple[str, bool | None, str | None, str | None, _Quality | None, NDArray[uint8] | None]
_Found = tuple[float, float, float, float, float, str]
_Object = tuple[float, float, float, float, str, float, int]
_Frame = tuple[_Image, str, int | None, str, str, list[_Object] | None]

_Own = tuple[str, float, float, bool | None]

__all__ = [
    "METHODS", "Bag", "Network", "Sensor", "Source", "__version__", "average_precision", "declared", "picture", "ssim", "stability_scene",
    "stability_scenes", "unwrap",
]

METHODS: list[str]
__version__: str

@final
class Sensor:
    def __new__(cls, parameters: Mapping[str, _Value]) -> Sensor: ...
    def expose(self, radiance: _Image) -> tuple[_Codes, _Codes, NDArray[uint8], NDArray[uint8]]: ...
    def auto_expose(self, radiance: _Image) -> tuple[_Codes, float]: ...

@final
class Bag:
    def __new__(cls, parameters: Mapping[str, _Value]) -> Bag: ...
    def __iter__(self) -> Iterator[_Frame]: ...
    def __next__(self) -> _Frame: ...

@final
class Source:
    def __new__(cls, parameters: Mapping[str, _Value]) -> Source: ...
    def __iter__(self) -> Iterator[_Frame]: ...
    def __next__(self) -> _Frame: ...

@final
class Network:
    def __new__(cls, **parameters: _Value) -> Network: ...
    def find(self, image: _Codes, threshold: float) -> list[_Found]: ...

def unwrap(
    codes: _Image, parameters: Mapping[str, _Value], confidence: bool
) -> tuple[NDArray[float32], NDArray[uint8], _Report]: ...
def picture(radiance: _Image, parameters: Mapping[str, _Value], deblur: bool) -> NDArray[uint8]: ...
def average_precision(
    frames: Sequence[tuple[Sequence[_Found], Sequence[_Object]]], difficulty: str
) -> dict[str, tuple[float, float, int]]: ...
def declared() -> list[tuple[str, _Value, str, str]]: ...
def ssim(left: NDArray[uint8], right: NDArray[uint8]) -> float | None: ...
def stability_scenes() -> int: ...
def stability_scene(number: int) -> tuple[str, str, str, int, float, bool, _Codes, NDArray[uint8], list[_Own]]: ...
