"""Random texts with substitutions, read by `modulo launch` and by the grammar of ROS 2's own `launch`.

    pip install lark
    python tests/peers/launch_grammar.py /opt/ros/jazzy/share/launch/frontend/grammar.lark target/debug/modulo [COUNT]

What `modulo` accepts must mean the same to ROS 2; it may refuse more. Exit code 1 when it does not.
"""

import json
import os
import random
import re
import subprocess
import sys
import tempfile

from lark import Lark, Token, Transformer
from lark.exceptions import LarkError

PIECES = ["$(env X ", "$(var v", "$(equals ", ")", " ", "a", "b", "\\", "'", '"', "$", "(", "é", "v", "\\(", "\\)",
          "\\'", '\\"', "\\$", "\\\\", "'a b'", '"c d"', " a", "$(var v)", "$(not true)"]
ENVIRONMENT, VARIABLES = {"X": "ex"}, {"v": "vee"}


class Calls(Transformer):
    """The tree as text and (name, arguments), as launch/frontend/parse_substitution.py makes it."""

    def part(self, children):
        (child,) = children
        return re.sub(r"\\(.)", r"\1", child.value) if isinstance(child, Token) else child

    single_quoted_part = double_quoted_part = part
    fragment = single_quoted_fragment = double_quoted_fragment = part

    def value(self, parts):
        return parts[0] if len(parts) == 1 and isinstance(parts[0], list) else parts

    single_quoted_value = double_quoted_value = value

    def arguments(self, values):
        return [*values[0], values[1]] if len(values) > 1 else values

    single_quoted_arguments = double_quoted_arguments = arguments

    def substitution(self, children):
        return children[0].value, (children[1] if len(children) > 1 else [])

    single_quoted_substitution = double_quoted_substitution = substitution

    def template(self, fragments):
        return fragments

    single_quoted_template = double_quoted_template = template


def evaluated(part):
    """The value of a part; KeyError or IndexError when it has none."""
    if isinstance(part, str):
        return part
    name, arguments = part[0], ["".join(map(evaluated, argument)) for argument in part[1]]
    if len(arguments) not in {"env": (1, 2), "var": (1, 2), "not": (1,), "equals": (2,)}[name]:
        raise KeyError(name)
    if name == "not":
        return {"true": "false", "1": "false", "false": "true", "0": "true"}[arguments[0].strip().lower()]
    if name == "equals":
        return "true" if arguments[0] == arguments[1] else "false"
    known = ENVIRONMENT if name == "env" else VARIABLES
    return known[arguments[0]] if len(arguments) == 1 else known.get(*arguments)


def theirs(parser, text):
    try:
        return "".join(map(evaluated, Calls().transform(parser.parse(text))))
    except (LarkError, KeyError, IndexError):
        return None


def ours(modulo, text, folder):
    path = os.path.join(folder, "x.launch.yaml")
    with open(path, "w", encoding="utf-8") as file:
        file.write("launch:\n  - let: { name: v, value: vee }\n")
        file.write(f"  - log:\n      message: {json.dumps(text)}\n")
    run = subprocess.run([modulo, "launch", "--print", path], capture_output=True, text=True, env=ENVIRONMENT)
    return run.stdout[len("log "):-len("\n\n")] if run.returncode == 0 else None


def main():
    parser = Lark.open(sys.argv[1], start="template")
    random.seed(1)
    both = refused = more = wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(int(sys.argv[3]) if len(sys.argv) > 3 else 1000):
            text = "".join(random.choice(PIECES) for _ in range(random.randint(1, 9)))
            expected, found = theirs(parser, text), ours(sys.argv[2], text, folder)
            if found is None:
                refused, more = refused + (expected is None), more + (expected is not None)
            elif found == expected:
                both += 1
            else:
                wrong += 1
                print(f"{text!r}: ours {found!r}, theirs {expected!r}")
    print(f"equal {both}, refused by both {refused}, by us alone {more}, different {wrong}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
