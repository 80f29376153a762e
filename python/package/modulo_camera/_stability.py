"""`stability`: the scenes of the stability suite against any method."""

import functools
from typing import NamedTuple

from modulo_camera import _core
from modulo_camera._benchmark import exactness
from modulo_camera._calls import Caller, Method, callables

# The scenes and what the suite recovers of them are the same for each method: 25 MB.
_scene = functools.cache(_core.stability_scene)

# The share of exact counts from which a scene is solved, as in the suite.
_SOLVED = 0.999


class Scene(NamedTuple):
    """The result of a method on a scene of the stability suite."""

    name: str
    """The name of the scene, as in `modulo eval stability`."""
    family: str
    """The family of the scene, such as `Steps`."""
    what: str
    """The content of the scene."""
    bits: int
    """The bits of the sensor."""
    alpha: float
    """The saturation factor."""
    observable: bool
    """Whether the modulo image is enough to know the counts. If not, another scene has the same image, and a solution is luck."""
    failure: str | None
    """The reason for which the method has no result; else `None`."""
    exact: float
    """The share of exact counts, 0 to 1; no offset is forgiven."""
    up_to_offset: float
    """The same share after the best offset for each channel."""
    ms: float
    """The time of the call in ms."""
    own: dict[str, float]
    """The share of exact counts of each method of the suite."""

    @property
    def solved(self) -> bool:
        """Whether at least 99.9 % of the counts are exact."""
        return self.exact >= _SOLVED


class Stability:
    """The results of `stability`."""

    scenes: list[Scene]
    """All scenes in the order of the suite."""

    def __init__(self, scenes: list[Scene]) -> None:
        self.scenes = scenes

    @property
    def solved(self) -> list[str]:
        """The names of the scenes that the method solves."""
        return [scene.name for scene in self.scenes if scene.solved]

    @property
    def only_here(self) -> list[str]:
        """The names of the scenes that the method solves and no method of the suite does."""
        return [scene.name for scene in self.scenes if scene.solved and max(scene.own.values()) < _SOLVED]

    @property
    def missed(self) -> list[str]:
        """The names of the scenes that the method does not solve and a method of the suite does."""
        return [scene.name for scene in self.scenes if not scene.solved and max(scene.own.values()) >= _SOLVED]

    @property
    def failures(self) -> dict[str, str]:
        """The reason for which the method has no result, by scene."""
        return {scene.name: scene.failure for scene in self.scenes if scene.failure is not None}

    def __str__(self) -> str:
        own = [name for name in self.scenes[0].own]
        solved = {name: sum(scene.own.get(name, 0.0) >= _SOLVED for scene in self.scenes) for name in own}
        rivals = ", ".join(f"{name} {count}" for name, count in solved.items())
        lines = [
            f"{len(self.solved)} of {len(self.scenes)} scenes are solved (at least 99.9 % of the counts are exact). Of the suite: {rivals}.",
            f"Solved here and by no method of the suite: {', '.join(self.only_here) or 'none'}.",
            f"Solved by a method of the suite and not here: {', '.join(self.missed) or 'none'}.",
        ]
        lines += [f"Without a result: {name} {why}." for name, why in self.failures.items()]
        return "\n".join(lines)


def stability(method: Method, *, time_limit_s: float | None = 100.0) -> Stability:
    """Runs a method on the scenes on which unwrapping methods fail, and compares it with the methods of the suite.

    The scenes are those of `modulo eval stability`: steps, islands, lamps, noise, sensors of 1 to 16 bits, tiny images, and more. Their
    sensors with a mosaic give H x W with one colour a pixel, and those with two gains leave every second pixel unwrapped,
    which `f(codes, bits, alpha)` is not told.

    Parameters
    ----------
    method : callable
        A callable `f(codes, bits, alpha)` as `benchmark` takes it.
    time_limit_s : float
        The limit of a call. `None` runs the method in this process and without a limit.

    Returns
    -------
    Stability
        The scenes with their results. Printed, it says which ones the method solves and the suite does not.

    Raises
    ------
    ValueError
        For what is not callable.

    Examples
    --------
    >>> import modulo_camera as modulo
    >>> result = modulo.stability(lambda codes, bits, alpha: modulo.Sensor(bits, alpha).unwrap(codes, "lines"))
    >>> result.only_here, len(result.missed) < 60
    ([], True)
    """
    (checked, _), = callables({"method": method}, [], 1).values()
    caller = Caller(checked, time_limit_s, 1)
    scenes = []
    try:
        for number in range(_core.stability_scenes()):
            name, family, what, bits, alpha, observable, codes, counts, own = _scene(number)
            call = caller(codes, bits, alpha)
            exact, up_to_offset = (0.0, 0.0) if call.counts is None else exactness(call.counts, counts)
            rivals = {rival: share for rival, share, *_ in own}
            scenes.append(Scene(name, family, what, bits, alpha, observable, call.failure, exact, up_to_offset, call.ms, rivals))
    finally:
        caller.close()
    return Stability(scenes)
