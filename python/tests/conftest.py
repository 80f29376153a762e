"""What the tests share: the binary of the suite, its test data, and the way in which a test is skipped without them."""

import importlib.util
import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def skip(request: pytest.FixtureRequest, why: str) -> None:
    """Skips the test as the tests of the suite do: with an entry in `MODULO_SKIPPED`, and not where data are required."""
    if os.environ.get("MODULO_REQUIRE_DATA") == "1":
        pytest.fail(f"MODULO_REQUIRE_DATA is 1, but {why}")
    if listed := os.environ.get("MODULO_SKIPPED"):
        with open(listed, "a") as file:
            file.write(f"{request.node.name}: {why}\n")
    pytest.skip(why)


@pytest.fixture
def binary(request: pytest.FixtureRequest) -> Path:
    """The program `modulo`: `MODULO_BINARY`, or that of the last build."""
    target = ROOT / os.environ.get("CARGO_TARGET_DIR", "target")
    found = [Path(os.environ.get("MODULO_BINARY", "")), target / "debug/modulo", target / "release/modulo"]
    existing = [path for path in found if path.is_file()]
    if not existing:
        skip(request, "there is no binary of modulo; run cargo build, or set MODULO_BINARY")
    return existing[0]


def shared(path: str) -> Path:
    """Returns the place of test data outside the project."""
    return Path(os.environ.get("MODULO_SHARED", ROOT.parent / "shared")) / path


@pytest.fixture
def spikes(request: pytest.FixtureRequest) -> Path:
    """Readings of a spike camera, whose pixels reset: 200 x 250 x 250 of 0 or 1."""
    file = shared("data/spike/uhsr.npz")
    if not file.is_file():
        skip(request, f"there is no {file}")
    return file


@pytest.fixture
def kitti(request: pytest.FixtureRequest) -> list[Path]:
    """The first 20 frames of KITTI."""
    folder = shared("data/kitti_object/image_2")
    frames = sorted(folder.glob("*.png"))[:20]
    if len(frames) < 20:
        skip(request, f"there are no 20 frames of KITTI in {folder}")
    return frames


@pytest.fixture
def packages(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The packages of the extra `examples`, with the folder of the examples on the path."""
    for name in ("matplotlib", "scipy", "skimage"):
        if importlib.util.find_spec(name) is None:
            skip(request, f"{name} is not installed (pip install './python[examples]')")
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.syspath_prepend(str(ROOT / "python/examples"))
