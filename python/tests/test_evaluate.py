"""`evaluate`: slices that an executor runs give the results of one run."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import modulo_camera as modulo


def test_slices_are_the_whole(binary: Path, tmp_path: Path) -> None:
    source = "scene://day?seed=3&frames=4&width=320&height=128"
    common: dict[str, Any] = {"source": source, "stream": "ideal,recovered", "engine": "rten", "program": str(binary)}
    whole = modulo.evaluate(out=tmp_path / "whole", vary={"alpha": [2, 4]}, **common)
    assert [cell["stream"] for cell in whole["cells"]] == 2 * ["ideal", "recovered"]
    with ThreadPoolExecutor(2) as executor:
        slices = [(0, 1), (1, 3), (3, 4)]
        cut = modulo.evaluate(out=tmp_path / "cut", vary={"alpha": [2, 4]}, slices=slices, executor=executor, **common)
    assert cut == whole
    assert (tmp_path / "cut/report.html").read_bytes() == (tmp_path / "whole/report.html").read_bytes()
    with pytest.raises(RuntimeError, match="nobody"):
        modulo.evaluate(out=tmp_path / "none", vary={"nobody.alpha": [2]}, **common)
