"""Writes the licences and the parts of the program: what a release must hold beside the binary.

    python3 tools/licences.py FOLDER TARGET

FOLDER gets `licences.txt`, the licence of each crate that is linked into `modulo` or the Python package with its text, and
`sbom.cdx.json`, the same crates as a bill of materials (CycloneDX 1.6). Both are read from `cargo metadata` and the lock files, for the platform TARGET.
"""

import json
import subprocess
import sys
import tomllib
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# The beginnings of the names of files that hold a licence.
NAMES = ("LICENSE", "LICENCE", "COPYING", "NOTICE", "UNLICENSE", "COPYRIGHT")


def linked(manifest, target):
    """Yields the packages that the package of `manifest` links on the platform `target`, itself first, and their direct dependencies."""
    command = ["cargo", "metadata", "--locked", "--format-version", "1", "--filter-platform", target, "--manifest-path", manifest]
    metadata = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    packages = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    waiting, seen = [metadata["resolve"]["root"]], set()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        # A crate that only a build script or a macro uses is no part of what is distributed, except for what it generates.
        needed = [d["pkg"] for d in nodes[name]["deps"] if any(kind["kind"] is None for kind in d["dep_kinds"])]
        waiting += needed
        yield packages[name], [packages[one] for one in needed]


def texts(package):
    """Returns the texts of the licence files in the folder of a package."""
    folder = Path(package["manifest_path"]).parent
    named = [folder / package["license_file"]] if package["license_file"] else []
    found = (file for file in sorted(folder.iterdir()) if file.is_file() and file.name.upper().startswith(NAMES))
    return [file.read_text(errors="replace").strip() for file in dict.fromkeys([*named, *found])]


def reference(package):
    """Returns the package URL of a package."""
    return f"pkg:cargo/{package['name']}@{package['version']}"


def component(package, checksums):
    """Returns the entry of a package in the bill of materials."""
    entry = {"type": "library", "bom-ref": reference(package), "purl": reference(package)}
    entry |= {"name": package["name"], "version": package["version"]}
    if package["license"]:
        # Cargo once allowed a slash, which SPDX does not know.
        entry["licenses"] = [{"expression": package["license"].replace("/", " OR ")}]
    if checksum := checksums.get((package["name"], package["version"])):
        entry["hashes"] = [{"alg": "SHA-256", "content": checksum}]
    return entry


def main():
    """Writes both files."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    packages, needs, checksums = {}, {}, {}
    for manifest in (ROOT / "Cargo.toml", ROOT / "python/Cargo.toml"):
        for package, needed in linked(manifest, sys.argv[2]):
            packages[reference(package)] = package
            needs.setdefault(reference(package), sorted(map(reference, needed)))
        lock = tomllib.loads(manifest.with_name("Cargo.lock").read_text())
        checksums |= {(p["name"], p["version"]): p["checksum"] for p in lock["package"] if "checksum" in p}
    foreign = [package for _, package in sorted(packages.items()) if package["source"]]

    users = defaultdict(list)
    for package in foreign:
        for text in texts(package):
            users[text].append(f"{package['name']} {package['version']}")
    with open(folder / "licences.txt", "w") as out:
        print("modulo contains these crates, each under the licence beside its name. The texts follow.\n", file=out)
        for package in foreign:
            print(f"{package['name']} {package['version']}: {package['license'] or 'see its text'}", file=out)
        for text, names in users.items():
            print(f"\n{'-' * 100}\n{', '.join(names)}\n\n{text}", file=out)

    product = next(package for package in packages.values() if package["name"] == "modulo-camera")
    bill = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": component(product, checksums) | {"type": "application"}},
        "components": [component(p, checksums) for _, p in sorted(packages.items()) if p is not product],
        "dependencies": [{"ref": name, "dependsOn": needed} for name, needed in sorted(needs.items())],
    }
    (folder / "sbom.cdx.json").write_text(json.dumps(bill, indent=1) + "\n")


if __name__ == "__main__":
    main()
