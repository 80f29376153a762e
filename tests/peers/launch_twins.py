"""Reads small launch files with ROS 2's own launch and with `modulo launch`, and compares them.

    . /opt/ros/jazzy/setup.bash && python3 tests/peers/launch_twins.py target/debug/modulo

Each file has one attribute with one form of value. A file that `modulo launch --print` accepts must be accepted by ROS 2. A
file with a node that both accept is launched by both, with a node that writes down its arguments: its name, parameters,
remaps, arguments and environment must be the same. Exit code 1 when a file breaks one of these rules.
"""

import json
import logging
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import yaml
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.frontend import Parser
from launch.launch_description_sources import AnyLaunchDescriptionSource

VALUES = {
    "bool": "true", "integer": "1", "float": "1.5", "word": "word", "quoted bool": '"true"', "quoted integer": '"1"',
    "quoted float": '"1.5"', "list": "[a, b]", "empty list": "[]", "mapping": "{a: b}", "null": "~", "empty": '""',
    "substitution": '"$(env SPY_WORD)"', "spaces": '"a b"', "negative": "-2", "quoted list": '"[1, 2]"',
    "exponent": "1.0e+3", "yes": "yes", "octal": "010", "quote": "\"it's\"", "colon": '"a: b"', "hash": '"a # b"',
    "date": "2011-09-26", "list of integers": "[1, 2]", "list of floats": "[1.5, 2.0]", "list of bools": "[true, no]",
    "list of quoted integers": '["1", "2"]', "mixed list": "[1, 2.0]", "condition": '"$(not false)"',
}
NODE = ["name", "namespace", "args", "ros_args", "output", "respawn", "respawn_delay",
        "on_exit", "sigterm_timeout", "sigkill_timeout", "if", "unless", "env", "param", "remap", "pkg", "exec"]
EXECUTABLE = ["cmd", "name", "output", "respawn", "respawn_delay", "on_exit", "sigterm_timeout",
              "sigkill_timeout", "env", "if", "unless"]
TYPES = ["int", "float", "bool", "str"]
SPY = '  - node: { pkg: "spy", exec: "spy", name: "seen" }\n'
SPY_SOURCE = '''#!/usr/bin/python3
import json, os, sys
files = {path: open(path).read() for path in sys.argv if os.path.isfile(path) and "launch_params" in path}
environment = {name: value for name, value in os.environ.items() if name.startswith("SPY_")}
json.dump([sys.argv[1:], files, environment], open(os.environ["SPY_OUT"], "a"))
'''


def action(name, attributes):
    return f"launch:\n  - {name}:\n" + "".join(f"      {key}: {value}\n" for key, value in attributes.items())


def files():
    """(label, text) of every file."""
    for label, value in VALUES.items():
        for attribute in NODE:
            fields = {"pkg": '"spy"', "exec": '"spy"', attribute: value}
            yield f"node.{attribute} = {label}", action("node", fields)
        for attribute in EXECUTABLE:
            yield f"executable.{attribute} = {label}", action("executable", {"cmd": '"true"', attribute: value})
        for attribute in ["name", "default", "description", "choice"]:
            yield f"arg.{attribute} = {label}", action("arg", {"name": '"x"', "default": '"1"', attribute: value})
        for name, fixed, attribute in [
            ("push_ros_namespace", {}, "namespace"), ("set_remap", {"from": '"a"'}, "to"), ("include", {}, "file"),
        ]:
            text = action(name, {**fixed, attribute: value}) + SPY
            yield f"{name}.{attribute} = {label} beside {sorted(fixed)}", text
        node = action("node", {"pkg": '"spy"', "exec": '"spy"'})
        yield f"param.value = {label}", f"{node}      param: [{{ name: p, value: {value} }}]\n"
        for kind in TYPES:
            yield f"param.value = {label} as {kind}", f"{node}      param: [{{ name: p, value: {value}, type: {kind} }}]\n"
    yield "root is a list", "- node: {pkg: spy, exec: spy}\n"
    for label, body in {
        "empty launch": " []", "no launch": "", "two keys in an entry": "\n  - arg: {name: a, default: b}\n    group: []",
        "unknown action": "\n  - nod: {pkg: spy, exec: spy}", "unknown key": "\n  - node: {pkg: spy, exec: spy, colour: red}",
        "group as list": "\n  - group:\n      - arg: {name: a, default: b}", "dollar": "\n  - arg: {name: a, default: 'x$y'}",
        "push-ros-namespace": "\n  - push-ros-namespace: {namespace: a}", "unclosed": "\n  - arg: {name: a, default: '$(var b'}",
        "unknown substitution": "\n  - arg: {name: a, default: '$(nope b)'}",
    }.items():
        yield label, f"launch:{body}\n"


def parsed_by_ros(path):
    """The reason for which ROS 2 refuses the file, or None."""
    try:
        entity, parser = Parser.load(str(path))
        parser.parse_description(entity)
    except Exception as why:  # whichever it is, the file is refused
        return f"{type(why).__name__}: {why}"
    return None


def run_in_ros(path):
    before = dict(os.environ)
    service = LaunchService(noninteractive=True)
    source = AnyLaunchDescriptionSource(str(path))
    service.include_launch_description(LaunchDescription([IncludeLaunchDescription(source)]))
    service.run()
    os.environ.clear()
    os.environ.update(before)


def parameters_of(text, name):
    """The parameters of a file that hold for the node, with dots between nested names."""
    found = {}

    def walk(tree, path):
        for key, value in tree.items():
            if isinstance(value, dict):
                walk(value, [*path, key])
            else:
                found[".".join([*path, str(key)])] = value

    for pattern, body in (yaml.safe_load(text) or {}).items():
        if pattern in ("/**", name, f"/{name}"):
            walk(body["ros__parameters"], [])
    return found


def meaning(text):
    """The arguments of the node as ROS 2's own client libraries read them, from the line that it wrote down."""
    if not text:
        return None
    arguments, files_read, environment = json.loads(text)
    own, ros, inside = [], [], False
    for argument in arguments:
        if argument in ("--ros-args", "--"):
            inside = argument == "--ros-args"
        else:
            (ros if inside else own).append(argument)
    remaps, parameters, rest = {}, {}, []
    ros = iter(ros)
    for flag in ros:
        if flag in ("-r", "--remap"):
            old, new = next(ros).split(":=", 1)
            remaps.setdefault(old, new)
        elif flag in ("-p", "--param"):
            name, value = next(ros).split(":=", 1)
            parameters[name] = yaml.safe_load(value)
        elif flag == "--params-file":
            path = next(ros)
            parameters |= parameters_of(files_read.get(path) or Path(path).read_text(), remaps.get("__node", "spy"))
        else:
            rest.append(flag)
    if remaps.get("__ns") in ("", "/"):
        del remaps["__ns"]
    return {"arguments": own, "remaps": remaps, "parameters": parameters, "other": rest,
            "environment": {name: value for name, value in environment.items() if name != "SPY_OUT"}}


def seen(out, start):
    """What the node wrote down while `start` ran."""
    out.write_text("")
    start()
    return meaning(out.read_text().partition("][")[0])


def main():
    modulo = str(Path(sys.argv[1]).resolve())
    logging.disable(logging.CRITICAL)
    refused, broken, compared, total = 0, [], 0, 0
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        out, spy = folder / "out", folder / "lib/spy/spy"
        spy.parent.mkdir(parents=True)
        spy.write_text(SPY_SOURCE)
        spy.chmod(0o755)
        for marker in ["share/spy/package.xml", "share/ament_index/resource_index/packages/spy"]:
            (folder / marker).parent.mkdir(parents=True)
            (folder / marker).write_text("")
        os.environ |= {"AMENT_PREFIX_PATH": f"{folder}:{os.environ['AMENT_PREFIX_PATH']}", "SPY_OUT": str(out),
                       "SPY_WORD": "word", "ROS_LOG_DIR": str(folder)}
        os.chdir(folder)
        for label, text in files():
            path = folder / "x.launch.yaml"
            path.write_text(text)
            total += 1
            checked = subprocess.run([modulo, "launch", "--print", path], capture_output=True, text=True)
            if checked.returncode != 0:
                refused += 1
                continue
            if why := parsed_by_ros(path):
                broken.append(f"{label}: ROS 2 refuses this file, and modulo does not: {why[:200]}")
            elif "spy" in text and "respawn" not in label:
                run = [modulo, "launch", path]
                ours = seen(out, lambda: subprocess.run(run, capture_output=True, timeout=60))
                theirs = seen(out, lambda: run_in_ros(path))
                compared += 1
                if ours != theirs:
                    broken.append(f"{label}:\n    modulo: {ours}\n    ROS 2:  {theirs}")
    print("\n".join(broken))
    print(f"{total} files: {refused} refused by modulo, {compared} launched by both, {len(broken)} differ")
    sys.exit(1 if broken else 0)


if __name__ == "__main__":
    main()
