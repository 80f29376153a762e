"""Calls of a method of any origin: in a process of its own with a limit of time, with its result checked."""

import hashlib
import inspect
import multiprocessing
import os
import signal
import time
import warnings
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from modulo_camera import Codes, METHODS, Sensor, Unwrapped, __version__

Method: TypeAlias = Callable[[Codes, int, float], Any]
"""A method: the codes (H x W or H x W x C), the bits and alpha in, the radiance in code units or (radiance, counts) out."""

_Answer: TypeAlias = tuple[str | None, float, float, NDArray[np.float32] | None, NDArray[np.int64] | None, bool | None]


class Call(NamedTuple):
    """The result of one call."""

    failure: str | None
    """The reason for which there is no result, as the end of a sentence; else `None`."""
    ms: float = 0.0
    """The wall-clock time of the call."""
    cpu_ms: float = 0.0
    """The processor time of all threads and child processes."""
    radiance: NDArray[np.float32] | None = None
    counts: NDArray[np.int64] | None = None
    trusted: bool | None = None


def own(name: str, threads: int) -> Method:
    """Returns a method of the suite as a callable."""
    return lambda codes, bits, alpha: Sensor(bits, alpha).unwrap(codes, name, options={"threads": threads})


def fingerprint(method: Method) -> str:
    """Returns a text that differs when the source of a callable does. What a callable refers to is not part of it."""
    source = getattr(method, "__wrapped__", method)
    source = source if inspect.isroutine(source) else type(source)
    try:
        text = inspect.getsource(source)
    except (OSError, TypeError):
        text = f"{getattr(source, '__module__', '')}.{getattr(source, '__qualname__', '')}"
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class Caller:
    """Calls a method: in a forked process if there is a limit of time, else in this one."""

    def __init__(self, method: Method, time_limit_s: float | None, threads: int) -> None:
        self._method, self._limit, self._threads = method, time_limit_s, threads
        self._process: Any = None
        self._pipe: Connection | None = None
        self.is_warm = False
        """Whether the process has had a call: the first one imports what the method needs."""
        if time_limit_s is not None and "fork" not in multiprocessing.get_all_start_methods():
            raise ValueError("time_limit_s needs a system that can fork a process; None runs the methods in this process")

    def __call__(self, codes: Codes, bits: int, alpha: float) -> Call:
        if self._limit is None:
            self.is_warm = True
            return Call(*_answer(self._method, codes, bits, alpha))
        if self._pipe is None:
            self._start()
        self.is_warm = True
        assert self._pipe is not None
        try:
            self._pipe.send((codes, bits, alpha))
            if self._pipe.poll(self._limit):
                return Call(*self._pipe.recv())
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode
            self.close()
            return Call(f"ended its process with {f'signal {-code}' if code < 0 else f'exit status {code}'}")
        self.close()
        return Call(f"took more than {self._limit:g} s")

    def _start(self) -> None:
        context = multiprocessing.get_context("fork")
        self._pipe, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other, self._pipe, self._method, self._threads), daemon=False)
        with warnings.catch_warnings():
            # numpy has threads, which the child does not use.
            warnings.simplefilter("ignore", DeprecationWarning)
            self._process.start()
        other.close()

    def close(self) -> None:
        """Ends the process, and what it has started."""
        if self._pipe is not None:
            self._pipe.close()
            try:
                os.killpg(self._process.pid, signal.SIGKILL)
            except OSError:
                self._process.kill()
            self._process.join()
        self._pipe = self._process = None
        self.is_warm = False


def _serve(pipe: Connection, parents: Connection, method: Method, threads: int) -> None:
    # A group of its own, so that what a method starts ends with it; an interrupt is the business of the parent.
    parents.close()
    os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])
    parent = os.getppid()
    while True:
        # Other children have copies of the pipe of a parent that was killed, so that no end of the pipe tells of it.
        while not pipe.poll(1):
            if os.getppid() != parent:
                return
        try:
            codes, bits, alpha = pipe.recv()
        except EOFError:
            return
        pipe.send(_answer(method, codes, bits, alpha))


def _processor_s() -> float:
    spent = os.times()
    # The clock of this process is fine; that of its children counts in hundredths of a second.
    return time.process_time() + spent.children_user + spent.children_system


def _answer(method: Method, codes: Codes, bits: int, alpha: float) -> _Answer:
    given = codes.copy()
    wall, cpu = time.perf_counter(), _processor_s()
    try:
        result = method(given, bits, alpha)
    except (Exception, SystemExit) as error:
        text = " ".join(str(error).split())
        return f"raised {type(error).__name__}{f': {text[:200]}' if text else ''}", 0.0, 0.0, None, None, None
    spent = 1e3 * (time.perf_counter() - wall), 1e3 * (_processor_s() - cpu)
    try:
        return None, *spent, *checked(result, codes, bits)
    except ValueError as error:
        return str(error), *spent, None, None, None


def checked(result: object, codes: Codes, bits: int) -> tuple[NDArray[np.float32], NDArray[np.int64], bool | None]:
    """Returns the radiance, the counts and the trust of a result.

    Raises
    ------
    ValueError
        With what the method has returned instead of the radiance or (radiance, counts).
    """
    trusted = result.report.trusted if isinstance(result, Unwrapped) else None
    given, whole = (result[0], result[1]) if isinstance(result, tuple) and len(result) >= 2 else (result, None)
    radiance = _array("radiance", given, codes)
    if not np.isfinite(radiance).all():
        raise ValueError(f"returned radiance with {int((~np.isfinite(radiance)).sum())} samples that are NaN or infinite")
    if whole is None:
        counts = np.rint((radiance.astype(np.float64) - codes) / 2**bits)
    else:
        counts = _array("counts", whole, codes)
        if not np.array_equal(counts, np.rint(counts)):
            raise ValueError("returned counts with samples that are no integers")
    # What is far out of range is wrong, and must not overflow.
    return radiance.astype(np.float32), counts.clip(-(2.0**31), 2.0**31).astype(np.int64), trusted


def _array(name: str, given: object, codes: Codes) -> NDArray[Any]:
    if not isinstance(given, np.ndarray) or given.dtype.kind not in "biuf":
        kind = f"an array of {given.dtype}" if isinstance(given, np.ndarray) else f"an object of type {type(given).__name__}"
        raise ValueError(f"returned {kind} as {name}, but an array of numbers is needed")
    if given.shape != codes.shape:
        raise ValueError(f"returned {name} of the shape {given.shape}, but the codes have {codes.shape}")
    return given


def callables(methods: "dict[str, Method]", names: "list[str]", threads: int) -> "dict[str, tuple[Method, str]]":
    """Returns each method with its fingerprint: those that were given, then those of the suite.

    Raises
    ------
    ValueError
        For a name that both have, that does not exist, or whose method is not callable.
    """
    found: dict[str, tuple[Method, str]] = {}
    for name, method in methods.items():
        if not callable(method):
            raise ValueError(f"method {name!r} is of type {type(method).__name__}, but must be a callable f(codes, bits, alpha)")
        if name in names:
            raise ValueError(f"method {name!r} has the name of a method of the suite; give it another name, or leave it out of include")
        found[name] = method, fingerprint(method)
    for name in names:
        if name not in METHODS:
            raise ValueError(f"include has {name!r}, but must have names out of {', '.join(METHODS)}")
        found[name] = own(name, threads), f"modulo {__version__}"
    if not found:
        raise ValueError("there is no method; methods or include must have one")
    return found
