"""The examples run, and what they show is what they print."""

import contextlib
import importlib.util
import io
import json
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "python/examples"


def test_the_notebook_prints_what_it_shows(packages: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    notebook = json.loads((EXAMPLES / "radiance_to_boxes.ipynb").read_text())
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "notebook"}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert len(cells) == 5
    for cell in cells:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec("".join(cell["source"]), names)
        shown = "".join("".join(output.get("text", "")) for output in cell["outputs"])
        assert printed.getvalue() == shown


def test_ten_lines_of_a_stranger_give_a_table_and_files(
    packages: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / "own_method.py"))
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" | ")[0].strip("| ") for line in lines[2:]] == [
        "rows", "scikit-image", "auto", "spud", "least_squares", "itoh", "lines", "tree", "gradient_tree",
    ]  # fmt: skip
    frames = Path("benchmark/frames.csv").read_text().splitlines()
    assert "method" in frames[0].split(",") and any("scikit-image" in line for line in frames[1:])
    assert Path("benchmark/results.json").stat().st_size > 0


def test_the_document_shows_the_example() -> None:
    code = (EXAMPLES / "own_method.py").read_text().split('"""', 2)[2].strip()
    plain = code.replace("codes: Any, bits: int, alpha: float) -> Any:", "codes, bits, alpha):").replace("from typing import Any\n\n", "")
    shown = (ROOT / "docs/how-to/own-method.md").read_text()
    assert plain.replace("\n\n\n", "\n\n") in shown.replace("\n\n\n", "\n\n")


def test_a_constant_is_found_without_the_true_counts(packages: None) -> None:
    from peers.adapters import congruent, located

    y = np.arange(120, dtype=np.uint8).reshape(4, 10, 3) * 2
    truth = (np.arange(120).reshape(4, 10, 3) % 4).astype(np.int64)
    phi = y + 256.0 * truth
    for shift in (0.0, 256 * 5.0, -256 * 7.0, 77.0):
        x, k = congruent(phi + shift, y, 8, 4.0)
        assert (k == truth).all() and (x == phi).all()
    # A fifth count is out of range: the most samples decide, and the one outside is clamped.
    outlier = phi.copy()
    outlier[0, 0, 1] += 256 * 9
    _, k = congruent(outlier, y, 8, 4.0)
    assert k[0, 0, 1] == 3 and (np.delete(k[..., 1].ravel(), 0) == np.delete(truth[..., 1].ravel(), 0)).all()
    # The dark end is taken where both ends fit.
    x, k = located(y + 512.0 + 256.0 * (truth > 2), y, 8, 4.0)
    assert set(np.unique(k)) == {0, 1} and np.allclose(x, y + 256.0 * (truth > 2))


def test_each_adapter_without_a_package_of_its_own_recovers_a_ramp(packages: None) -> None:
    from peers.adapters import ADAPTERS

    import modulo_camera as modulo

    ramp = np.tile(np.linspace(0, 1, 128, dtype=np.float32)[None, :, None], (32, 1, 3))
    exposure = modulo.Sensor(8, 4).expose(ramp)
    tried = 0
    for name, (adapter, module) in ADAPTERS.items():
        if importlib.util.find_spec(module) is not None and module in ("numpy", "scipy", "skimage"):
            x, k = adapter(exposure.modulo, 8, 4.0)
            assert (k == exposure.counts).mean() > 0.99 and x.shape == k.shape == exposure.modulo.shape, name
            tried += 1
    assert tried == 3


def test_a_physics_of_deepinverse_undoes_its_wraps() -> None:
    for name in ("torch", "deepinv"):
        if importlib.util.find_spec(name) is None:
            pytest.skip(f"{name} is not installed; python/examples/deepinv_physics.py says how to install it")
    import torch

    import modulo_camera as modulo

    example = runpy.run_path(str(EXAMPLES / "deepinv_physics.py"), run_name="example")
    ramp = torch.linspace(0, 0.99, 128).expand(2, 3, 32, 128)
    physics = example["ModuloCamera"](modulo.Sensor(8, 4))
    codes = physics(ramp)
    assert codes.shape == ramp.shape and codes.max() == 255
    found = physics.A_dagger(codes)
    # Half a code of 0.97 * 4 * 256, and the same codes again.
    assert (found - ramp).abs().max() < 0.51 / (0.97 * 1024)
    assert torch.equal(physics(found), codes)
