"""Boxes of `modulo eval` as pycocotools reads them, and slices of frames on the executors of others.

    pip install pycocotools==2.0.11 numpy "dask[distributed]" submitit
    python3 tests/peers/evaluate.py target/debug/modulo

Exit code 1 when the AP50 of pycocotools differs by 1e-6, or when the report of eight slices on an executor is not that of one run.
"""

import contextlib
import importlib
import io
import json
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from replay import check

FOLDER = Path(__file__).resolve().parents[2] / "python/package/modulo_camera"
sys.path.insert(0, str(FOLDER))
# The workers import it by this name, as they would from the wheel.
evaluate = importlib.import_module("_evaluate")

SCENES = ["scene://day?seed=3&frames=12&width=480&height=160", "scene://glare?seed=4&frames=12&width=480&height=160"]
DRIVE = "scene://day?seed=3&frames=40&width=160&height=64&light=trees"


def ap50(annotations: Path, boxes: Path) -> dict[str, float]:
    """The AP50 of each category, at all recalls and up to 100 boxes."""
    with contextlib.redirect_stdout(io.StringIO()):
        labels = COCO(str(annotations))
        scored = COCOeval(labels, labels.loadRes(str(boxes)), "bbox")
        scored.evaluate()
        scored.accumulate()
    precision = scored.eval["precision"][0, :, :, 0, 2]
    names = {category["id"]: category["name"] for category in labels.dataset["categories"]}
    rows = zip(scored.params.catIds, precision.T)
    return {names[category]: float(np.mean(row)) for category, row in rows if row.max() >= 0}


def coco(modulo: str, folder: Path) -> None:
    """The exported boxes have the AP50 of the report."""
    streams = ["--stream", "ideal,saturated,modulo,recovered", "--method", "auto", "--deblur", "off", "--alpha", "4", "--engine", "rten"]
    sources = [word for scene in SCENES for word in ("--source", scene)]
    subprocess.run([modulo, "eval", *sources, *streams, "-o", folder / "out"], check=True, capture_output=True)
    # COCO has no object that is ignored, found or not: a crowd takes any number of boxes.
    (folder / "groups.yaml").write_text("car: vehicle\nvan: vehicle\ntruck: vehicle\nbus: vehicle\npedestrian: person\ncyclist:\n")
    command = [modulo, "eval", "report", folder / "out", "--difficulty", "all", "--groups", folder / "groups.yaml", "--coco", folder / "coco"]
    subprocess.run(command, check=True, capture_output=True)
    cells = json.loads((folder / "out/results.json").read_text())["cells"]
    files = sorted((folder / "coco/results").iterdir())
    check(len(files) == len(cells), f"{len(files)} files of boxes for {len(cells)} cells")
    ours = sorted(sorted((group, ap) for group, ap in cell["ap50"].items() if ap is not None) for cell in cells)
    theirs = sorted(sorted(ap50(folder / "coco/annotations.json", file).items()) for file in files)
    for own, other in zip(ours, theirs, strict=True):
        near = [abs(a - b) < 1e-6 and name == group for (name, a), (group, b) in zip(own, other, strict=True)]
        check(all(near), f"AP50 {own}, by pycocotools {other}")


def slices(modulo: str, folder: Path) -> None:
    """Eight slices on each executor, and one run."""
    import submitit
    from dask.distributed import Client, LocalCluster

    options = {"source": DRIVE, "stream": "ideal,recovered,auto_exposed", "engine": "rten", "jobs": 1}

    def run(name: str, cut: list[tuple[int, int]], executor: object) -> tuple[bytes, bytes]:
        out = folder / name
        evaluate.evaluate("compare.launch.yaml", out, {"alpha": [2, 4]}, {}, options, cut, executor, modulo)
        return (out / "results.json").read_bytes(), (out / "report.html").read_bytes()

    whole = run("whole", [], None)
    cut = [(first, first + 5) for first in range(0, 40, 5)]
    with ProcessPoolExecutor(4) as executor:
        check(run("processes", cut, executor) == whole, "a pool of processes gives the report of one run")
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        client.run(sys.path.insert, 0, str(FOLDER))
        check(run("dask", cut, client) == whole, "so does Dask")
    executor = submitit.LocalExecutor(folder / "submitit")
    executor.update_parameters(timeout_min=10)
    with contextlib.redirect_stderr(io.StringIO()):
        check(run("local", cut, executor) == whole, "so does submitit")


def main() -> None:
    modulo = str(Path(sys.argv[1]).resolve())
    with tempfile.TemporaryDirectory() as folder:
        coco(modulo, Path(folder))
        slices(modulo, Path(folder))


if __name__ == "__main__":
    main()
