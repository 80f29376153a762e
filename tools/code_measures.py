"""Prints measures of the Rust code: lengths of files and functions, shares of comments, equal bodies, names used twice.

    python3 -m venv VENV && VENV/bin/pip install tree-sitter==0.26.1 tree-sitter-rust==0.24.2
    VENV/bin/python tools/code_measures.py [--check] [FOLDER]

With --check, the exit code is 1 where a limit of the project does not hold: a function is to fit a screen, and a file a sitting.
"""

import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import tree_sitter_rust
from tree_sitter import Language, Parser

PARSER = Parser(Language(tree_sitter_rust.language()))
# The smallest number of bytes, without spaces, of a function body that is compared with the others.
SMALLEST_BODY = 120
TYPES = {"struct_item", "enum_item", "trait_item", "union_item"}


def percentile(values, percent):
    """The nearest-rank percentile."""
    ranked = sorted(values)
    return ranked[min(len(ranked) - 1, len(ranked) * percent // 100)] if ranked else 0


def is_test(node, text):
    """Whether an attribute right before `node` is #[test] or #[cfg(test)]."""
    before = node.prev_sibling
    while before is not None and before.type in ("attribute_item", "line_comment"):
        if before.type == "attribute_item" and b"test" in text[before.start_byte : before.end_byte]:
            return True
        before = before.prev_sibling
    return False


class Measures:
    """What is counted over all files."""

    def __init__(self):
        self.files, self.functions, self.product = {}, {}, {}
        self.lines = self.code = self.docs = self.comments = self.tests = 0
        self.bodies, self.types = defaultdict(list), defaultdict(set)

    def add(self, path):
        """Counts one file."""
        text = path.read_bytes()
        lines = text.decode().splitlines()
        self.files[str(path)] = len(lines)
        self.lines += len(lines)
        for line in map(str.strip, lines):
            is_doc, is_comment = line.startswith(("///", "//!")), line.startswith("//")
            self.docs += is_doc
            self.comments += is_comment and not is_doc
            self.code += bool(line) and not is_comment
        self.visit(PARSER.parse(text).root_node, text, path, "tests" in path.parts)

    def visit(self, node, text, path, in_tests):
        """Counts `node` and everything below it."""
        in_tests = in_tests or (node.type in ("mod_item", "function_item") and is_test(node, text))
        if node.type == "function_item":
            self.count_function(node, text, path, in_tests)
        if node.type in TYPES and not in_tests:
            self.types[node.child_by_field_name("name").text.decode()].add(str(path))
        for child in node.children:
            self.visit(child, text, path, in_tests)

    def count_function(self, node, text, path, in_tests):
        """Counts a function's length, and its body among the others'."""
        self.tests += is_test(node, text)
        body = node.child_by_field_name("body")
        place = f"{path}:{node.start_point[0] + 1} {node.child_by_field_name('name').text.decode()}"
        self.functions[place] = node.end_point[0] - node.start_point[0] + 1
        if not in_tests:
            self.product[place] = self.functions[place]
        words = b"".join(text[body.start_byte : body.end_byte].split())
        if len(words) >= SMALLEST_BODY and not in_tests:
            self.bodies[words].append(place)

    def report(self):
        """Prints the table; returns the limits that do not hold."""
        files, functions = list(self.files.values()), list(self.functions.values())
        below = 100 * sum(n < 40 for n in files) / len(files)
        fn_p99 = percentile(functions, 99)
        comments = 100 * self.comments / self.lines
        equal = [places for places in self.bodies.values() if len(places) > 1]
        shared = {name: paths for name, paths in self.types.items() if len(paths) > 1}
        print(f"files                       {len(files)}, of which {below:.1f} % have fewer than 40 lines")
        print(f"lines                       {self.lines}, of which {self.code} are code")
        print(f"file p50/p90/max            {percentile(files, 50)}/{percentile(files, 90)}/{max(files)} lines")
        print(f"function p50/p90/p99/max    {percentile(functions, 50)}/{percentile(functions, 90)}/{fn_p99}/{max(functions)} lines")
        print(f"doc comments                {100 * self.docs / self.lines:.1f} % of the lines")
        print(f"plain comments              {comments:.1f} % of the lines")
        print(f"tests                       {self.tests}, {1000 * self.tests / self.lines:.1f} per 1000 lines")
        print(f"equal bodies of functions   {len(equal)}")
        print(*(f"    {', '.join(places)}" for places in equal), sep="\n")
        print(f"names of several types      {len(shared)}")
        print(*(f"    {name}: {', '.join(sorted(paths))}" for name, paths in sorted(shared.items())), sep="\n")
        longest = sorted(self.functions.items(), key=lambda item: -item[1])[:8]
        print("longest functions", *(f"    {length:4} {place}" for place, length in longest), sep="\n")
        drivers = [n for path, n in self.files.items() if "crates/middleware/src/driver/" in path]
        limits = {
            "no file has more than 700 lines": max(files) <= 700,
            "no file of a driver has more than 350 lines": max(drivers, default=0) <= 350,
            "no function of the product has more than 40 lines": max(self.product.values()) <= 40,
            "no two functions have equal bodies": not equal,
        }
        return [name for name, holds in limits.items() if not holds]


def main():
    """Measures the tracked Rust files below a folder."""
    arguments = [argument for argument in sys.argv[1:] if argument != "--check"]
    folder = Path(arguments[0] if arguments else ".")
    tracked = subprocess.run(["git", "-C", folder, "ls-files", "*.rs"], capture_output=True, text=True, check=True)
    measures = Measures()
    for name in tracked.stdout.split():
        measures.add(folder / name)
    missed = measures.report()
    print(f"limits that do not hold     {', '.join(missed) or 'none'}")
    sys.exit(1 if missed and "--check" in sys.argv else 0)


if __name__ == "__main__":
    main()
