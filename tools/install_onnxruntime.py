#!/usr/bin/env python3
"""Put ONNX Runtime's library where `modulo` finds it.

    python tools/install_onnxruntime.py [--folder FOLDER] [--arch x86_64|aarch64] [--wheel FILE]

The pinned wheel comes from PyPI through pip (or is FILE, copied here by hand), is checked by sha256, and only
libonnxruntime.so is taken out of it. Needs Python 3.9 and pip, Linux with glibc 2.28. Nothing is installed into Python.
"""

import argparse
import hashlib
import os
import platform
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

VERSION = "1.31.1"
# The library does not depend on Python: one wheel an architecture will do. From `pip hash WHEEL`.
PYTHON = "3.12"
SHA256 = {
    "x86_64": "1f3dea47f2f0e5117c2404cea7d21fd253ae7836a3bf167a501cdfbb2600d536",
    "aarch64": "0b9a492176886992e0e875f06bc0367e333f5fff11711a2d642e18b02f3009cc",
}
MEMBER = f"onnxruntime/capi/libonnxruntime.so.{VERSION}"
BESIDE_THE_BINARY = Path(__file__).resolve().parent.parent / "target" / "release"


def parse():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=BESIDE_THE_BINARY, help="where the library goes (%(default)s)")
    parser.add_argument("--arch", default=platform.machine(), help="x86_64 or aarch64 (%(default)s)")
    parser.add_argument("--wheel", type=Path, help="a wheel that is here already, for machines without a network")
    return parser.parse_args()


def download(arch, folder):
    """The pinned wheel, in `folder`."""
    pin = folder / "pin.txt"
    pin.write_text(f"onnxruntime=={VERSION} --hash=sha256:{SHA256[arch]}\n")
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:"]
    command += ["--python-version", PYTHON, "--platform", f"manylinux_2_27_{arch}", "--platform", f"manylinux_2_28_{arch}"]
    command += ["--require-hashes", "--requirement", str(pin), "--dest", str(folder)]
    if subprocess.run(command, stdout=sys.stderr).returncode != 0:
        sys.exit(
            f"pip could not download onnxruntime {VERSION} for {arch} (its reason is above); without a network, copy "
            f"that wheel (cp{PYTHON.replace('.', '')}, manylinux, {arch}) here and give it with --wheel FILE"
        )
    return next(folder.glob("*.whl"))


def extract(wheel, arch, folder):
    """The library of `wheel`, checked, in `folder`. A library that is there is replaced as a whole."""
    content = wheel.read_bytes()
    got = hashlib.sha256(content).hexdigest()
    if got != SHA256[arch]:
        sys.exit(f"{wheel}: sha256 is {got}, expected is {SHA256[arch]} (onnxruntime {VERSION}, {arch}); nothing is installed")
    with zipfile.ZipFile(wheel) as archive:
        library = archive.read(MEMBER)
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / "libonnxruntime.so"
    unfinished = folder / "libonnxruntime.so.part"
    unfinished.write_bytes(library)
    unfinished.chmod(0o755)
    os.replace(unfinished, target)
    return target.resolve()


def main():
    args = parse()
    arch = {"amd64": "x86_64", "arm64": "aarch64"}.get(args.arch.lower(), args.arch)
    if arch not in SHA256:
        sys.exit(f"--arch {arch}: must be x86_64 or aarch64")
    with tempfile.TemporaryDirectory() as scratch:
        wheel = args.wheel or download(arch, Path(scratch))
        library = extract(wheel, arch, args.folder)
    print(f"export ORT_DYLIB_PATH={library}")


if __name__ == "__main__":
    main()
