"""`evaluate`: `modulo eval` over slices of frames, each of which any executor may run, on this machine or on another one."""

import json
import os
import shutil
import subprocess
import sysconfig
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol


class Future(Protocol):
    """What an executor gives for a call that it has taken."""

    def result(self) -> Any:
        """Waits for the call, and returns its value."""


class Executor(Protocol):
    """Runs calls somewhere: `concurrent.futures`, `dask.distributed.Client`, submitit's executors."""

    def submit(self, fn: Any, /, *args: Any) -> Future:
        """Takes a call."""


def program() -> str:
    """The program that the wheel has installed, or the one on the path."""
    own = Path(sysconfig.get_path("scripts")) / "modulo"
    found = str(own) if own.exists() else shutil.which("modulo")
    if found is None:
        raise FileNotFoundError("the program modulo is neither beside this Python nor on the path")
    return found


def run(arguments: Sequence[str], binary: str | None) -> None:
    """Runs the program; exit code 3, something that cannot be scored, is a matter of the report."""
    done = subprocess.run([binary or program(), *arguments], capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):
        raise RuntimeError(f"modulo {' '.join(arguments)} ended with {done.returncode}: {done.stderr.strip()}")


def words(vary: Mapping[str, Iterable[Any]], arguments: Mapping[str, Any], options: Mapping[str, Any]) -> list[str]:
    """The words of a command line."""
    given = [f"{name}:={value}" for name, value in arguments.items()]
    for name, values in vary.items():
        given += ["--vary", f"{name}={','.join(map(str, values))}"]
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        values = value if isinstance(value, list | tuple) else [value]
        given += [option] if value is True else [word for one in values for word in (option, str(one))]
    return given


def evaluate(
    file: str,
    out: str | os.PathLike[str],
    vary: Mapping[str, Iterable[Any]],
    arguments: Mapping[str, Any],
    options: Mapping[str, Any],
    slices: Sequence[tuple[int, int]],
    executor: Executor | None,
    binary: str | None,
) -> dict[str, Any]:
    """Runs the slices, and scores what all of them have found."""
    place = Path(out).absolute()
    command = ["eval", file, *words(vary, arguments, options), "--out", str(place)]
    cut = [[*command, "--frames", f"{first}:{end}"] for first, end in slices]
    if executor is None:
        for one in cut:
            run(one, binary)
    else:
        for future in [executor.submit(run, one, binary) for one in cut]:
            future.result()
    # It finds the slices done, runs what is missing, and draws the report of all.
    run(command, binary)
    results: dict[str, Any] = json.loads((place / "results.json").read_text())
    return results
