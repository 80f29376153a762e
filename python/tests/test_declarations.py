"""Names, defaults, ranges and help of the arguments are those that the nodes declare."""

import inspect
from collections.abc import Callable
from typing import Any

import pytest

import modulo_camera as modulo
from modulo_camera import _core

DECLARED = {name: (default, allowed, help_text) for name, default, allowed, help_text in _core.declared()}

# The arguments that no node declares: arrays, their axes and paths, and what a node gives as a topic of its own.
OWN = {"self", "codes", "radiance", "image", "channel_axis", "path", "source", "confidence", "options"}

# Where Python has no file formats, the help of the node would be wrong; a path has several types.
OWN_HELP = {(modulo.Sensor, "white")}
OWN_TYPE = {(modulo.detect, "model")}

# In Python a lens that is not given is an unknown one: None in place of a width.
OWN_DEFAULT: dict[str, tuple[Any, Any]] = {"psf_sigma": (None, float | None), "psf": ("gaussian", str)}

DOCUMENTED: list[Callable[..., Any]] = [
    modulo.Sensor,
    modulo.Sensor.unwrap,
    modulo.detect,
    modulo.read_bag,
    modulo.read_source,
]


@pytest.mark.parametrize("function", DOCUMENTED)
def test_arguments_are_those_that_the_nodes_declare(function: Callable[..., Any]) -> None:
    text = " ".join((inspect.getdoc(function) or "").split())
    arguments = {name: one for name, one in inspect.signature(function).parameters.items() if name not in OWN}
    assert arguments
    for name, argument in arguments.items():
        default, allowed, help_text = DECLARED["score_threshold" if name == "threshold" else name]
        own, annotation = OWN_DEFAULT.get(name, (default, type(default)))
        assert (argument.default, type(argument.default)) == (own, type(own)), name
        if (function, name) not in OWN_TYPE:
            assert argument.annotation == annotation, name
            assert f"{name} : {type(default).__name__}, {allowed}" in text, name
        assert (function, name) in OWN_HELP or help_text in text, name


def test_options_are_those_that_the_node_declares() -> None:
    text = " ".join((inspect.getdoc(modulo.Sensor.unwrap) or "").split())
    for name in modulo._OPTIONS:
        default, allowed, help_text = DECLARED[name]
        assert f"- {name} : {type(default).__name__}, {allowed}, {default}. {help_text}" in text, name


def test_the_whole_sensor_and_method_can_be_set() -> None:
    """No parameter of the nodes is forgotten, except those of a stream and of a node that keeps running."""
    stream = {"source", "source_topic", "rate", "loop", "frames", "frame_id", "budget", "exposure", "alpha_most"}
    stream |= {"input", "fallback", "cameras", "max_det", "nms_iou", "input_size", "classes", "class_map", "score_threshold"}
    stream |= {"cudnn_search"}
    given = {name for function in DOCUMENTED for name in inspect.signature(function).parameters} | {"deblur", *modulo._OPTIONS}
    assert set(DECLARED) - stream <= given


def test_the_methods_are_those_of_the_parameter() -> None:
    assert f"one of {', '.join(modulo.METHODS)}" == DECLARED["method"][1]


def test_all_that_is_public_is_documented() -> None:
    public = set(modulo.__all__) - {"METHODS", "Codes", "Image", "__version__"}
    assert all(inspect.getdoc(getattr(modulo, name)) for name in public)
    own = {name for name, value in vars(modulo).items() if str(getattr(value, "__module__", "")).startswith("modulo_camera")}
    assert {name for name in own if not name.startswith("_")} == public
